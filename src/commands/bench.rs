//! `ibgs bench`

use super::{Model, open_gpu};
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::bench::{self, Timing};
use ibgs_core::camera::Camera;
use ibgs_core::raster::Rasterizer;
use ibgs_core::scene::{MAX_SH_DEGREE, Splats};
use serde_json::json;
use std::path::PathBuf;

/// Largest image side in pixels.
const MAX_SIDE: u32 = 16_384;

/// Gaussians of a synthetic scene.
const MOST_GAUSSIANS: usize = 50_000_000;

/// Options of `ibgs bench`.
#[derive(ClapArgs)]
pub struct Args {
    /// Model folder; left out: a synthetic scene.
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
    let (raster, splats, camera) = match &args.model {
        Some(path) => {
            let model = Model::open(path, None, args.adapter.as_ref())?;
            let cameras = model.folder.read_cameras()?;
            let camera = cameras.first().context("the model has no cameras")?.camera;
            (model.raster, model.splats, camera)
        }
        None => synthetic(args)?,
    };
    let timing = bench::measure(&raster, &splats, &camera, args.iterations)?;
    print(&timing, &splats, &camera);
    if let Some(path) = &args.json {
        let report = json!({
            "device": raster.gpu().describe(),
            "gaussians": splats.len(),
            "size": [camera.width, camera.height],
            "intersections": timing.intersections,
            "frame_ms": timing.frame_ms,
            "iteration_ms": timing.iteration_ms,
            "stages_ms": timing.stages.iter().map(|(name, ms)| json!({"stage": name, "ms": ms})).collect::<Vec<_>>(),
        });
        ibgs_core::files::write_atomically(path, |out| serde_json::to_writer_pretty(out, &report).map_err(Into::into))?;
    }
    Ok(())
}

fn synthetic(args: &Args) -> Result<(Rasterizer, Splats, Camera)> {
    let side = |text: &str| text.parse().ok().filter(|side| (1..=MAX_SIDE).contains(side));
    let size = args.size.split_once('x').and_then(|(width, height)| Some((side(width)?, side(height)?)));
    let Some((width, height)) = size else {
        bail!("option `--size` is `{}`; write it as WIDTHxHEIGHT, each from 1 to {MAX_SIDE}", args.size);
    };
    if args.sh_degree > MAX_SH_DEGREE {
        bail!("option `--sh-degree` is {}; it must be 0, 1, 2 or 3", args.sh_degree);
    }
    let gpu = open_gpu(args.adapter.as_ref())?;
    let (gaussians, camera) = bench::synthetic(args.gaussians, args.sh_degree, width, height);
    let splats = Splats::upload(&gaussians, &gpu)?;
    Ok((Rasterizer::new(gpu), splats, camera))
}

fn print(timing: &Timing, splats: &Splats, camera: &Camera) {
    println!(
        "{} Gaussians, {} x {}, {} tile intersections",
        splats.len(),
        camera.width,
        camera.height,
        timing.intersections
    );
    for (name, ms) in &timing.stages {
        println!("{name:<24} {ms:>9.3} ms");
    }
    println!("{:<24} {:>9.3} ms", "frame, wall clock", timing.frame_ms);
    println!("{:<24} {:>9.3} ms", "iteration, wall clock", timing.iteration_ms);
}
