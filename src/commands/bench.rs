//! `ibgs bench`

use super::model::is_bundle;
use super::open_gpu;
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::bench::{self, Timing};
use ibgs_core::bundle::Bundle;
use ibgs_core::camera::Camera;
use ibgs_core::scene::{Gaussians, MAX_SH_DEGREE, read_ply};
use ibgs_core::train::config::{Method, TrainConfig};
use ibgs_core::train::output::OutputFolder;
use serde_json::json;
use std::path::PathBuf;

/// Largest image side in pixels.
const MAX_SIDE: u32 = 16_384;

/// Gaussians of a synthetic scene.
const MOST_GAUSSIANS: usize = 50_000_000;

/// Options of `ibgs bench`.
#[derive(ClapArgs)]
pub struct Args {
    /// Model folder or `.ibgs` bundle; left out: a synthetic scene.
    model: Option<PathBuf>,
    /// Gaussians of the synthetic scene.
    #[arg(long, default_value_t = 100_000)]
    gaussians: usize,
    /// Image size of the synthetic scene, WIDTHxHEIGHT.
    #[arg(long, default_value = "960x540")]
    size: String,
    /// Spherical-harmonics degree of the synthetic scene.
    #[arg(long, default_value_t = 2)]
    sh_degree: u32,
    /// Iterations measured after as many for warm-up.
    #[arg(long, default_value_t = 20)]
    iterations: u32,
    /// Also write the figures to a JSON file.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Adapter by number or part of its name; `ibgs info` lists them.
    #[arg(long)]
    adapter: Option<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    if args.gaussians > MOST_GAUSSIANS {
        bail!("option `--gaussians` is {}; it must be at most {MOST_GAUSSIANS}", args.gaussians);
    }
    if args.iterations == 0 {
        bail!("option `--iterations` is 0; it must be at least 1");
    }
    let mut config = TrainConfig::default();
    let no_cameras = "the model has no cameras";
    let (gaussians, camera) = match &args.model {
        Some(path) if is_bundle(path) => {
            let bundle = Bundle::read(path)?;
            config = bundle.config;
            (bundle.gaussians, bundle.cameras.first().context(no_cameras)?.camera)
        }
        Some(path) => {
            let folder = OutputFolder::open(path)?;
            // Folders of other programs have none.
            if folder.config_path().exists() {
                config = folder.read_config()?;
            }
            let iteration = folder.latest_iteration()?.context("the folder holds no point cloud")?;
            let gaussians = read_ply(&folder.point_cloud_path(iteration))?;
            let camera = folder.read_cameras()?.first().context(no_cameras)?.camera;
            (gaussians, camera)
        }
        None => synthetic(args)?,
    };
    let gpu = open_gpu(args.adapter.as_ref())?;
    let measure = |method| -> Result<Timing> {
        let timing = bench::measure(&gpu, &gaussians, &camera, (method, &config), args.iterations)?;
        print((method, &config), &timing, gaussians.len(), &camera);
        Ok(timing)
    };
    let (base, image) = (measure(Method::Gs3)?, measure(Method::Ibgs)?);
    if let Some(path) = &args.json {
        let one = |timing: &Timing| {
            let stages: Vec<_> = timing.stages.iter().map(|(name, ms)| json!({"stage": name, "ms": ms})).collect();
            json!({
                "intersections": timing.intersections,
                "frame_ms": timing.frame_ms,
                "cold_frame_ms": timing.cold_frame_ms,
                "iteration_ms": timing.iteration_ms,
                "memory_reserved_bytes": timing.memory,
                "stages_ms": stages,
            })
        };
        let report = json!({
            "device": gpu.describe(),
            "gaussians": gaussians.len(),
            "size": [camera.width, camera.height],
            "3dgs": one(&base),
            "ibgs": one(&image),
        });
        ibgs_core::files::write_atomically(path, |out| serde_json::to_writer_pretty(out, &report).map_err(Into::into))?;
    }
    Ok(())
}

fn synthetic(args: &Args) -> Result<(Gaussians, Camera)> {
    let side = |text: &str| text.parse().ok().filter(|side| (1..=MAX_SIDE).contains(side));
    let size = args.size.split_once('x').and_then(|(width, height)| Some((side(width)?, side(height)?)));
    let Some((width, height)) = size else {
        bail!("option `--size` is `{}`; write it as WIDTHxHEIGHT, each from 1 to {MAX_SIDE}", args.size);
    };
    if args.sh_degree > MAX_SH_DEGREE {
        bail!("option `--sh-degree` is {}; it must be 0, 1, 2 or 3", args.sh_degree);
    }
    Ok(bench::synthetic(args.gaussians, args.sh_degree, width, height))
}

fn print((method, config): (Method, &TrainConfig), timing: &Timing, gaussians: usize, camera: &Camera) {
    let (name, sources) = match method {
        Method::Gs3 => ("3dgs", String::new()),
        _ => ("ibgs", format!(", {} sources", config.sources.used.min(bench::NEIGHBOURS))),
    };
    println!(
        "{name}: {gaussians} Gaussians, {} x {}, {} tile intersections{sources}",
        camera.width, camera.height, timing.intersections
    );
    let line = |name: &str, ms: f64| println!("{name:<32} {ms:>9.3} ms");
    for (name, ms) in &timing.stages {
        line(name, *ms);
    }
    line("frame, wall clock", timing.frame_ms);
    if let Some(cold) = timing.cold_frame_ms {
        line("frame with depth maps of sources", cold);
    }
    line("iteration, wall clock", timing.iteration_ms);
    if let Some(memory) = timing.memory {
        println!("{:<32} {:>9.1} MiB", "device memory reserved", memory as f64 / f64::from(1 << 20));
    }
}
