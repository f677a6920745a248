//! `ibgs info`

mod model;

use super::split;
use crate::stdout;
use anyhow::{Result, bail};
use clap::Args as ClapArgs;
use glam::DVec3;
use ibgs_core::blocks::PlanFolder;
use ibgs_core::counted;
use ibgs_core::dataset::{self, SceneInfo};
use ibgs_core::gpu::{AdapterChoice, Gpu, GpuError, Use, lacking, list_adapters, tested};
use ibgs_core::local_space::Length;
use ibgs_core::model::is_bundle;
use ibgs_core::residual::unet::choice;
use ibgs_core::scene::{Gaussians, is_gaussians, read_gaussians};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  ibgs info my-scene
  ibgs info                                      # the adapters of this machine";

/// Options of `ibgs info`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Scene folder, model folder, `.ibgs` bundle, file of Gaussians (`.ply` and others) or plan of `ibgs split` [default: list
    /// the adapters of this machine].
    path: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    match &args.path {
        None => adapters(),
        Some(path) if !path.exists() => bail!("{} does not exist; check the path", path.display()),
        Some(path) if is_bundle(path) => model::show(path),
        Some(path) if !dataset::is_archive(path) && is_gaussians(path) => model_file(path),
        Some(path) if path.join("point_cloud").is_dir() => model::show(path),
        Some(path) if PlanFolder::at(path).holds_plan() => plan(&PlanFolder::at(path)),
        Some(path) => scene(path),
    }
}

fn plan(folder: &PlanFolder) -> Result<()> {
    let source = folder.config()?.source.unwrap_or_default();
    stdout!("{}: a plan of blocks for {}", folder.root().display(), source.display());
    split::print(folder, &folder.read()?)
}

fn adapters() -> Result<()> {
    let adapters = list_adapters();
    if adapters.is_empty() {
        return Err(GpuError::NoAdapter.into());
    }
    for (index, adapter) in adapters.iter().enumerate() {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        stdout!("{index}: {} ({:?}, {:?})", info.name, info.device_type, info.backend);
        stdout!("   driver             {} {}", info.driver, info.driver_info);
        stdout!("   storage binding    {} MiB", limits.max_storage_buffer_binding_size >> 20);
        stdout!("   buffer             {} MiB", limits.max_buffer_size >> 20);
        stdout!("   storage buffers    {} a stage", limits.max_storage_buffers_per_shader_stage);
        stdout!("   workgroup memory   {} KiB", limits.max_compute_workgroup_storage_size >> 10);
        stdout!("   subgroup size      {} to {}", info.subgroup_min_size, info.subgroup_max_size);
        for m in adapter.cooperative_matrix_properties() {
            stdout!(
                "   matrix units       {:?} {}x{}x{}, sums in {:?}",
                m.ab_type,
                m.m_size,
                m.n_size,
                m.k_size,
                m.cr_type
            );
        }
        if lacking(adapter, Use::Rendering).is_empty() {
            let result = tested(&info, "self-test", || self_test(index));
            stdout!("   self-test          {}", result.unwrap_or_else(|error| error.to_string()));
        }
        let [rendering, training] = [Use::Rendering, Use::Training].map(|wanted| lacking(adapter, wanted).join(", "));
        match (rendering.is_empty(), training.is_empty()) {
            (_, true) => stdout!("   usable             yes"),
            (true, false) => stdout!("   usable             for rendering, not for training: lacks {training}"),
            (false, _) => stdout!("   usable             no, lacks {rendering}"),
        }
    }
    Ok(())
}

/// What the adapter gets right, on a device of its own.
fn self_test(index: usize) -> Result<String, GpuError> {
    let gpu = Gpu::open(&AdapterChoice::Named(index.to_string()), Use::Rendering)?;
    let subgroups = match gpu.subgroup_lanes {
        Some(lanes) => format!("subgroups of {lanes} lanes are right"),
        None => "no subgroups are used".to_owned(),
    };
    let matrices = match choice::error(&gpu)? {
        Some(error) if error > choice::TOLERANCE => format!("matrix units are wrong by {error:.1e} and not used"),
        Some(_) => "matrix units are right".to_owned(),
        None => "no matrix units are used".to_owned(),
    };
    Ok(format!("{subgroups}; {matrices}"))
}

fn model_file(path: &Path) -> Result<()> {
    gaussians(path, &read_gaussians(path)?);
    Ok(())
}

fn gaussians(path: &Path, g: &Gaussians) {
    if g.is_empty() {
        stdout!("{}: no Gaussians; the file is empty", path.display());
        return;
    }
    stdout!("{}: {}, spherical harmonics of degree {}", path.display(), counted(g.len(), "Gaussian"), g.sh_degree);
    let fold = |(low, high): (DVec3, DVec3), p: DVec3| (low.min(p), high.max(p));
    let (low, high) = g.positions().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), fold);
    for (axis, name) in ["x", "y", "z"].iter().enumerate() {
        stdout!("   {name} from {} to {}", Length(low[axis]), Length(high[axis]));
    }
    if g.space.origin != DVec3::ZERO {
        stdout!("   kept around the offset {}", g.space.origin);
    }
}

fn scene(path: &Path) -> Result<()> {
    let info = dataset::inspect(path)?;
    let (photos, points) = (counted(info.images, "photo"), counted(info.points, "point"));
    stdout!("{}: {} scene, {photos}, {points}", info.path.display(), info.kind);
    layout(&info);
    for camera in &info.cameras {
        let pair = |v: Option<glam::DVec2>| v.map_or("unknown".to_owned(), |v| format!("{:.2} {:.2}", v.x, v.y));
        stdout!(
            "   camera {}: {} {} x {}, focal {}, principal point {}, {}{}",
            camera.id,
            camera.model,
            camera.width,
            camera.height,
            pair(camera.focal),
            pair(camera.principal),
            counted(camera.images, "photo"),
            match (camera.focal, camera.distorted) {
                (None, _) => ", not supported",
                (Some(_), true) => ", undistorted on load (blank edges do not count)",
                (Some(_), false) => "",
            }
        );
    }
    info.notes.iter().for_each(|note| stdout!("   note: {note}"));
    if let Some(refused) = &info.refused {
        stdout!("   `ibgs train` refuses it: {refused}");
    }
    Ok(())
}

/// The files of a scene: what lists the photos, which of them have a pose, their sizes and their split.
fn layout(info: &SceneInfo) {
    stdout!("   read from {}", info.listing.display());
    if info.models.len() > 1 {
        let models: Vec<String> = info
            .models
            .iter()
            .map(|model| format!("{} with {}", model.folder, counted(model.images, "photo")))
            .collect();
        stdout!("   {} COLMAP models that do not connect, the first is used: {}", models.len(), models.join(", "));
    }
    let posed = info.images - info.missing.len();
    stdout!("   {} with a pose, {} without{}", counted(posed, "photo"), info.unposed.len(), such_as(&info.unposed));
    if !info.missing.is_empty() {
        stdout!("   {} not found{}", counted(info.missing.len(), "photo"), such_as(&info.missing));
    }
    if !info.unreadable.is_empty() {
        stdout!("   {} not readable{}", counted(info.unreadable.len(), "photo"), such_as(&info.unreadable));
    }
    for size in &info.sizes {
        stdout!("   {} of {} x {}", counted(size.photos, "photo"), size.width, size.height);
    }
    if info.masks > 0 {
        stdout!("   masks of {} of {posed} photos", info.masks);
    }
    if info.refused.is_none() {
        stdout!("   with `--eval` {} train and {} are held out: {}", info.split.train, info.split.test, info.split.by);
    }
}

fn such_as(names: &[String]) -> String {
    names.first().map_or_else(String::new, |name| format!(", for instance {name}"))
}
