//! The formats of scenes: how a folder shows which one it has, and who reads it.

use super::info::Inspected;
use super::{DatasetError, LoadOptions, Scene, colmap, llff, nerf, neus, reality_capture};
use std::path::Path;

/// The format of a scene.
pub(super) enum Format {
    Colmap,
    Transforms,
    RealityCapture,
    Llff,
    Neus,
}

/// The format of a scene folder, or of the scene that a file stands for.
pub(super) fn format_of(path: &Path) -> Result<Format, DatasetError> {
    std::fs::metadata(path).map_err(|cause| DatasetError::read(path, &cause))?;
    if colmap::is_scene(path) {
        Ok(Format::Colmap)
    } else if nerf::is_scene(path) {
        Ok(Format::Transforms)
    } else if colmap::is_nerfstudio_scene(path) {
        Ok(Format::Colmap)
    } else if reality_capture::is_scene(path) {
        Ok(Format::RealityCapture)
    } else if llff::is_scene(path) {
        Ok(Format::Llff)
    } else if neus::is_scene(path) {
        Ok(Format::Neus)
    } else if colmap::is_flat_scene(path) {
        Ok(Format::Colmap)
    } else {
        Err(DatasetError::NotAScene { path: path.to_owned() })
    }
}

/// Reads the views of a scene, in the order of its files.
pub(super) fn read(path: &Path, options: &LoadOptions) -> Result<Scene, DatasetError> {
    match format_of(path)? {
        Format::Colmap => colmap::read(path, options),
        Format::Transforms => nerf::read(path, options),
        Format::RealityCapture => reality_capture::read(path, options),
        Format::Llff => llff::read(path, options),
        Format::Neus => neus::read(path, options),
    }
}

/// Reads a scene's metadata.
pub(super) fn inspect(path: &Path) -> Result<Inspected, DatasetError> {
    match format_of(path)? {
        Format::Colmap => colmap::inspect(path),
        Format::Transforms => nerf::inspect(path),
        Format::RealityCapture => reality_capture::inspect(path),
        Format::Llff => llff::inspect(path),
        Format::Neus => neus::inspect(path),
    }
}
