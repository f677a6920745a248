//! Timing of every stage, by GPU timestamps, and of whole frames and iterations, by the wall clock.

use crate::camera::Camera;
use crate::dataset::Photo;
use crate::gpu::GpuError;
use crate::loss::{ImageLoss, Target};
use crate::raster::{Leaves, RasterView, Rasterizer, Room};
use crate::render::render_base;
use crate::scene::{Gaussians, Splats};
use crate::train::config::{AdamConfig, LearningRates};
use crate::train::optim::{Optimizer, Rates};
use glam::{DMat3, DVec2, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
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
    /// Milliseconds of one training iteration: render, loss, backward, Adam.
    pub iteration_ms: f64,
}

/// Which stage a kernel belongs to.
fn stage(kernel: &str) -> &'static str {
    match kernel {
        "project" => "project",
        "rasterize" => "blend",
        "rasterize_backward" => "blend backward",
        "project_backward" => "project backward",
        "image_loss" | "image_loss_total" | "image_loss_backward" => "loss",
        "adam" => "adam",
        _ => "sort",
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

/// Measures `iterations` frames and training iterations after as many for warm-up. The photo is the model's own
/// picture, so the model hardly moves.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn measure(raster: &Rasterizer, splats: &Splats, camera: &Camera, iterations: u32) -> Result<Timing, GpuError> {
    let gpu = raster.gpu().clone();
    let view = RasterView::new(*camera, splats.sh_degree());
    let picture = render_base(raster, splats, camera)?;
    let rgba = picture.to_rgb8().chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
    let target = Target::upload(&gpu, &Photo { width: camera.width, height: camera.height, rgba })?;
    let loss = ImageLoss::new(gpu.clone(), 0.2);
    let mut optimizer = Optimizer::new(&gpu, splats, AdamConfig::default(), false)?;
    let rates = Rates::new(&LearningRates::default(), 1e-6);
    let mut iterate = || -> Result<(), GpuError> {
        let leaves = Leaves::new(splats);
        let (image, _forward) = raster.tracked(&leaves, &view)?;
        let (value, _scratch) = loss.tracked(image, &target)?;
        let mut gradients = value.backward();
        let gradients = leaves.gradients(&mut gradients).expect("the loss depends on the image");
        optimizer.step(&gpu, gradients, &rates);
        Ok(())
    };
    let time = |count: u32, work: &mut dyn FnMut() -> Result<(), GpuError>| -> Result<f64, GpuError> {
        gpu.wait()?;
        let start = Instant::now();
        for _ in 0..count {
            work()?;
        }
        gpu.wait()?;
        Ok(1e3 * start.elapsed().as_secs_f64() / f64::from(count))
    };
    let mut frame = || raster.surface(splats, &view, Room::Assumed).map(drop);
    time(iterations, &mut frame)?;
    let frame_ms = time(iterations, &mut frame)?;
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
    let intersections = raster.count_intersections(splats, &view)?;
    Ok(Timing { intersections, stages, frame_ms, iteration_ms })
}
