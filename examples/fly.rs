//! Flies through a bundle with levels of detail (`ibgs export --levels`) within a limit of device memory: times of the frames, memory,
//! and how far a view at rest is from one of the whole model.
//!
//! ```sh
//! cargo run --release --example fly -- city.ibgs 2GiB 500 40 0 0
//! ```
//!
//! The numbers are the frames and a way in scene units that is added to a flight from training camera to training camera.

#![expect(clippy::print_stdout, reason = "an example")]

use glam::{DMat3, DQuat, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::gpu::{AdapterChoice, Gpu, Use};
use ibgs_core::levels::Loading;
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::render::{Frame, Renderer};
use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Frames from one training camera to the next.
const BETWEEN: usize = 25;
/// Frames that are also rendered at rest.
const COMPARED: usize = 50;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [bundle, memory, frames, way @ ..] = &words[..] else { return Err("give a bundle, a size, a number".into()) };
    let (path, frames): (PathBuf, usize) = (bundle.into(), frames.parse()?);
    let way: Vec<f64> = way.iter().map(|number| number.parse()).collect::<Result<_, _>>()?;
    let way = DVec3::from_slice(if way.is_empty() { &[0.0; 3] } else { &way });
    let gpu = Gpu::open(&AdapterChoice::Best, Use::Rendering)?;
    println!("{}", gpu.describe());
    let open = |gpu_memory: &str, loading| -> Result<(Model, Renderer), Box<dyn Error>> {
        let options = ModelOptions { gpu_memory: gpu_memory.parse()?, loading, ..ModelOptions::default() };
        let mut model = Model::open(&path, &options)?;
        let renderer = model.renderer(&gpu)?;
        Ok((model, renderer))
    };
    let (model, moving) = open(memory, Loading::FLYING)?;
    let training = model.training_views();
    let camera = |frame: usize| {
        let at = frame as f64 / BETWEEN as f64;
        let [a, b] = [at as usize, at as usize + 1].map(|i| &training[i % training.len()].camera);
        between(a, b, at.fract(), way * frame as f64 / frames as f64)
    };
    // Kernels and buffers are made.
    for _ in 0..20 {
        moving.render(&camera(0))?;
    }
    let (mut times, mut shown) = (Vec::new(), Vec::new());
    for frame in 0..frames {
        let start = Instant::now();
        moving.render(&camera(frame))?;
        times.push(start.elapsed());
        shown.extend(moving.stream().map(|stream| stream.shown()));
        // A screen of 60 frames a second.
        std::thread::sleep(Duration::from_micros(16_667).saturating_sub(start.elapsed()));
    }
    times.sort_unstable();
    shown.sort_unstable();
    let at = |part: f64| times[(part * (times.len() - 1) as f64) as usize].as_secs_f64() * 1e3;
    println!(
        "{frames} frames: median {:.2} ms, 99th percentile {:.2} ms, longest {:.2} ms",
        at(0.5),
        at(0.99),
        at(1.0)
    );
    if let Some(median) = shown.get(shown.len() / 2) {
        println!("Gaussians of a frame: median {median}; places for {}", moving.splats().len());
    }
    report(&gpu, "flying");
    drop(moving);
    let (_, resting) = open(memory, Loading::Complete)?;
    let (_, whole) = open("none", Loading::Complete)?;
    if whole.stream().is_some() {
        return Err("the device cannot hold the whole model to compare with".into());
    }
    println!("the whole has {} Gaussians", whole.splats().len());
    compare(&resting, &whole, (0..frames).step_by(frames.div_ceil(COMPARED)).map(camera))
}

/// Prints how the frames of a model in parts, at rest, differ from those of the whole model.
fn compare(resting: &Renderer, whole: &Renderer, cameras: impl Iterator<Item = Camera>) -> Result<(), Box<dyn Error>> {
    let (mut base, mut last) = (Vec::new(), Vec::new());
    for camera in cameras {
        let (ours, theirs) = (resting.render(&camera)?, whole.render(&camera)?);
        base.push(psnr(&ours.base()?.rgb, &theirs.base()?.rgb));
        let image = |frame: &Frame| -> Result<Vec<f32>, Box<dyn Error>> {
            Ok(frame.image()?.map_or_else(|| frame.base(), Ok)?.rgb)
        };
        last.push(psnr(&image(&ours)?, &image(&theirs)?));
    }
    for (what, mut values) in [("base", base), ("final", last)] {
        values.sort_by(f64::total_cmp);
        println!("{what} at rest: least {:.1} dB, median {:.1} dB", values[0], values[values.len() / 2]);
    }
    Ok(())
}

fn report(gpu: &Arc<Gpu>, what: &str) {
    if let Some(report) = gpu.memory_report() {
        println!("device memory, {what}: {} MiB", report.reserved_bytes >> 20);
    }
}

/// The camera on the way from one to another, moved by `step`.
fn between(a: &Camera, b: &Camera, part: f64, step: DVec3) -> Camera {
    let turn = DQuat::from_mat3(&a.view_from_world).slerp(DQuat::from_mat3(&b.view_from_world), part);
    let view_from_world = DMat3::from_quat(turn);
    let centre = a.center().lerp(b.center(), part) + step;
    Camera { view_from_world, translation: -(view_from_world * centre), ..*a }
}

fn psnr(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (sum / a.len() as f64).max(1e-12).log10()
}
