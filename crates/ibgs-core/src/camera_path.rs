//! nerfstudio's camera-path JSON.

use crate::camera::Camera;
use glam::{DMat3, DMat4, DVec2, DVec3};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Why a camera path cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CameraPathError {
    /// The file cannot be read.
    #[error("cannot read the camera path {}: {source}; check the path", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is not a camera path.
    #[error("{} is not a usable camera path: {reason}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Field and what is wrong with it.
        reason: String,
    },
}

#[derive(Deserialize)]
struct File {
    camera_path: Vec<Key>,
    render_width: u32,
    render_height: u32,
}

#[derive(Deserialize)]
struct Key {
    /// Row by row, OpenGL axes.
    camera_to_world: [f64; 16],
    /// Vertical, degrees.
    fov: f64,
}

/// Cameras of the frames, in order.
#[derive(Clone, Debug)]
pub struct CameraPath {
    /// One camera a frame.
    pub cameras: Vec<Camera>,
}

/// Largest frame side in pixels.
const MAX_SIDE: u32 = 16_384;

impl CameraPath {
    /// Reads a camera path.
    ///
    /// # Errors
    /// [`CameraPathError`] naming file and field.
    pub fn load(path: &Path) -> Result<Self, CameraPathError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| CameraPathError::Read { path: path.to_owned(), source })?;
        let invalid = |reason: String| CameraPathError::Invalid { path: path.to_owned(), reason };
        let file: File = serde_json::from_str(&text).map_err(|e| invalid(e.to_string()))?;
        if file.camera_path.is_empty() {
            return Err(invalid("`camera_path` is empty".to_owned()));
        }
        for (name, side) in [("render_width", file.render_width), ("render_height", file.render_height)] {
            if side == 0 || side > MAX_SIDE {
                return Err(invalid(format!("`{name}` is {side}; it must lie between 1 and {MAX_SIDE}")));
            }
        }
        let cameras = file.camera_path.iter().enumerate().map(|(i, key)| {
            camera(key, file.render_width, file.render_height)
                .map_err(|what| invalid(format!("camera_path[{i}]: {what}")))
        });
        Ok(Self { cameras: cameras.collect::<Result<_, _>>()? })
    }
}

fn camera(key: &Key, width: u32, height: u32) -> Result<Camera, String> {
    if !key.camera_to_world.iter().all(|v| v.is_finite()) {
        return Err("`camera_to_world` holds a number that is not finite".to_owned());
    }
    if !(key.fov > 0.0 && key.fov < 180.0) {
        return Err(format!("`fov` is {}; it must lie between 0 and 180 degrees", key.fov));
    }
    let m = DMat4::from_cols_array(&key.camera_to_world).transpose();
    let axes = [m.x_axis, m.y_axis, m.z_axis].map(|a| a.truncate().normalize_or_zero());
    // OpenGL looks along -z with y up.
    let world_from_view = DMat3::from_cols(axes[0], -axes[1], -axes[2]);
    if (world_from_view.determinant() - 1.0).abs() > 1e-3 {
        return Err("`camera_to_world` is no rotation".to_owned());
    }
    let center: DVec3 = m.w_axis.truncate();
    let view_from_world = world_from_view.transpose();
    let focal = 0.5 * f64::from(height) / (0.5 * key.fov.to_radians()).tan();
    Ok(Camera {
        width,
        height,
        focal: DVec2::splat(focal),
        principal: DVec2::new(f64::from(width), f64::from(height)) / 2.0,
        view_from_world,
        translation: -(view_from_world * center),
    })
}
