//! Timing of every stage, by GPU timestamps, and of whole frames and iterations, by the wall clock.

use crate::camera::Camera;
use crate::dataset::{Dataset, Photo, View};
use crate::fuse::sources::SourceOptions;
use crate::gpu::{Gpu, GpuError};
use crate::raster::{RasterView, Rasterizer};
use crate::render::render_base;
use crate::scene::{Gaussians, Splats};
use crate::train::config::{Method, TrainConfig};
use crate::train::{TrainError, Trainer};
use glam::{DMat3, DVec2, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use std::time::Instant;

/// Figures of one scene.
#[derive(Clone, Debug)]
pub struct Timing {
    /// Tile intersections of the view.
    pub intersections: u64,
    /// Milliseconds of GPU time by stage of a training iteration; empty where the device has no timestamps.
    pub stages: Vec<(String, f64)>,
    /// Milliseconds of one rendered frame.
    pub frame_ms: f64,
    /// Milliseconds of one rendered frame for which the depth maps of its sources are rendered too; none without sources.
    pub cold_frame_ms: Option<f64>,
    /// Milliseconds of one training iteration: render, losses, backward, Adam.
    pub iteration_ms: f64,
    /// Bytes of device memory reserved while training; none where the driver does not tell.
    pub memory: Option<u64>,
}

/// Which stage a kernel belongs to; those of the image-based part are listed by their own names.
fn stage(kernel: &'static str) -> &'static str {
    match kernel {
        "rasterize" | "rasterize_surface" => "blend",
        "rasterize_backward" | "rasterize_surface_backward" => "blend backward",
        "image_loss" | "image_loss_total" | "image_loss_backward" => "image loss",
        "gather" | "scan_reduce" | "scan_blocks" | "scan_apply" | "sort_count" | "sort_scatter" | "tile_emit"
        | "tile_ranges" => "sort",
        other => other,
    }
}

/// A cloud of small Gaussians in front of a camera: the load of a real scene without its files.
pub fn synthetic(count: usize, sh_degree: u32, width: u32, height: u32) -> (Gaussians, Camera) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut g = Gaussians::with_capacity(count, sh_degree);
    g.sh_degree = sh_degree;
    // A million Gaussians have a standard deviation of about two pixels.
    let size = 0.003 * (1e6 / count.max(1) as f32).sqrt();
    let coefficients = ((sh_degree + 1) * (sh_degree + 1)) as usize;
    for _ in 0..count {
        let depth = rng.random_range(2.0..10.0f32);
        let (x, y) = (rng.random_range(-0.6..0.6f32), rng.random_range(-0.4..0.4f32));
        g.means.push([x * depth, y * depth, depth]);
        g.rotations.push(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        g.log_scales.push(std::array::from_fn(|_| (size * depth * rng.random_range(0.1..1.0f32)).ln()));
        g.opacity_logits.push(rng.random_range(-2.0..3.0));
        g.sh.extend((0..3 * coefficients).map(|_| rng.random_range(-0.3..0.3f32)));
        g.normals.push([0.0, 0.0, 1.0]);
        g.offsets.push(0.0);
    }
    let camera = Camera {
        width,
        height,
        focal: DVec2::splat(f64::from(width)),
        principal: DVec2::new(f64::from(width), f64::from(height)) / 2.0,
        view_from_world: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    (g, camera)
}

/// The camera and four neighbours of it, each with the model's own picture as its photo.
fn views(raster: &Rasterizer, splats: &Splats, camera: &Camera) -> Result<Dataset, GpuError> {
    let mut views = Vec::new();
    for (index, [x, y]) in [[0.0, 0.0], [0.1, 0.0], [-0.1, 0.0], [0.0, 0.1], [0.0, -0.1]].into_iter().enumerate() {
        let moved = Camera { translation: camera.translation + DVec3::new(x, y, 0.0), ..*camera };
        let picture = render_base(raster, splats, &moved)?;
        let rgba = picture.to_rgb8().chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
        let photo = Arc::new(Photo { width: camera.width, height: camera.height, rgba });
        views.push(View { name: index.to_string(), camera: moved, photo });
    }
    let train = (0..views.len()).collect();
    Ok(Dataset { path: Default::default(), views, train, test: Vec::new(), points: Vec::new(), notes: Vec::new() })
}

/// Neighbours of the measured view.
pub const NEIGHBOURS: u32 = 4;

/// Options of a training in which every stage of the method is at work from the second iteration on and nothing is densified.
/// How much the stages compute is the model's own.
fn options(method: Method, model: &TrainConfig) -> TrainConfig {
    let usual = TrainConfig::default();
    let sources = SourceOptions { used: model.sources.used, visible: model.sources.visible, ..usual.sources };
    let (surface, residual, exposure) = (model.surface.clone(), model.residual.clone(), model.exposure.clone());
    let mut config = TrainConfig { method, sources, surface, residual, exposure, ..usual };
    (config.iterations, config.sh_interval, config.densify.end) = (1_000_000, Some(1), Some(1));
    config.learning_rates.mean_initial = 1e-9;
    config.learning_rates.mean_final = 1e-9;
    config.surface.start = Some(0);
    config.residual.start = Some(0);
    config.residual.burn_in = Some(0);
    config
}

/// Measures `iterations` frames and training iterations after as many for warm-up, by `method` with the image-based
/// stages as `model` has them. The photos are the model's own pictures, so the model hardly moves.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn measure(
    gpu: &Arc<Gpu>,
    gaussians: &Gaussians,
    camera: &Camera,
    (method, model): (Method, &TrainConfig),
    iterations: u32,
) -> Result<Timing, TrainError> {
    let raster = Arc::new(Rasterizer::new(gpu.clone()));
    let dataset = views(&raster, &Splats::upload(gaussians, gpu)?, camera)?;
    let mut trainer = Trainer::from_gaussians(raster.clone(), &dataset, &options(method, model), gaussians)?;
    let time = |count: u32, work: &mut dyn FnMut() -> Result<(), TrainError>| -> Result<f64, TrainError> {
        gpu.wait()?;
        let start = Instant::now();
        for _ in 0..count {
            work()?;
        }
        gpu.wait()?;
        Ok(1e3 * start.elapsed().as_secs_f64() / f64::from(count))
    };
    let mut iterate = || trainer.step();
    time(iterations, &mut iterate)?;
    let iteration_ms = time(iterations, &mut iterate)?;
    let mut stages: Vec<(String, f64)> = Vec::new();
    if gpu.start_profile() {
        time(iterations, &mut iterate)?;
        for (kernel, ms, _) in gpu.finish_profile() {
            let (name, ms) = (stage(kernel), ms / f64::from(iterations));
            match stages.iter_mut().find(|(n, _)| n == name) {
                Some((_, sum)) => *sum += ms,
                None => stages.push((name.to_owned(), ms)),
            }
        }
    }
    let memory = gpu.reserved_memory();
    let renderer = trainer.renderer();
    renderer.render(camera)?;
    let mut frame = || Ok(renderer.render_unchecked(camera).map(drop)?);
    time(iterations, &mut frame)?;
    let frame_ms = time(iterations, &mut frame)?;
    let mut cold = || {
        renderer.forget_depths();
        Ok(renderer.render_unchecked(camera).map(drop)?)
    };
    let cold_frame_ms = renderer.part().map(|_| time(iterations, &mut cold)).transpose()?;
    let view = RasterView::new(*camera, gaussians.sh_degree);
    let intersections = raster.count_intersections(trainer.splats(), &view)?;
    Ok(Timing { intersections, stages, frame_ms, cold_frame_ms, iteration_ms, memory })
}
