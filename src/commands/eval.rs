//! `ibgs eval`

use super::{Model, load_scene, protocol, score_test_views};
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::dataset::Dataset;
use ibgs_core::eval::frames_per_second;
use ibgs_core::files::write_atomically;
use ibgs_core::train::output::cameras::Split;
use ibgs_core::train::output::results::{Scored, means};
use serde_json::json;
use std::path::PathBuf;

/// Passes over the test views when frames are counted.
const PASSES: u32 = 5;

/// Options of `ibgs eval`.
#[derive(ClapArgs)]
pub struct Args {
    /// Model folder, as `ibgs train` writes it.
    model: PathBuf,
    /// Scene folder, when it has moved since the training.
    #[arg(short, long)]
    source: Option<PathBuf>,
    /// Iteration to measure; left out: the latest.
    #[arg(long)]
    iteration: Option<u32>,
    /// Adapter by number or part of its name; `ibgs info` lists them.
    #[arg(long)]
    adapter: Option<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let model = Model::open(&args.model, args.iteration, args.adapter.as_ref())?;
    let dataset = scene_of(&model, args)?;
    if dataset.test.is_empty() {
        bail!("the scene has no held-out views; train with `--eval`");
    }
    let background = model.background();
    println!("{:<32} {:>8} {:>8}", "view", "PSNR", "SSIM");
    let target = (&model.folder, model.iteration);
    let scores = score_test_views(&model.raster, &model.splats, &dataset, background, target, |score| {
        println!("{:<32} {:>8.3} {:>8.4}", score.name, score.psnr, score.ssim);
    })?;
    let mean = means(&scores);
    println!("{:<32} {:>8.3} {:>8.4}", "mean", mean.psnr, mean.ssim);
    let views = dataset.test.iter().map(|&i| &dataset.views[i]);
    let fps = frames_per_second(&model.raster, &model.splats, views, background, PASSES)?;
    println!("{fps:.1} frames per second, {} Gaussians, LPIPS not computed", model.splats.len());
    let protocol = protocol(&model.config, &dataset, model.raster.gpu());
    model.folder.write_results(model.iteration, Scored::Base, &scores, &protocol)?;
    let speed = json!({ format!("ours_{}", model.iteration): {
        "FPS": fps, "gaussians": model.splats.len(), "passes": PASSES, "device": model.raster.gpu().describe(),
    } });
    let path = model.folder.root().join("result_fps_mem.json");
    write_atomically(&path, |out| serde_json::to_writer_pretty(out, &speed).map_err(Into::into))?;
    Ok(())
}

/// The scene that the model was trained on, with the model's own split.
fn scene_of(model: &Model, args: &Args) -> Result<Dataset> {
    let records = model.folder.read_cameras()?;
    let mut dataset = match args.source.as_ref().or(model.config.data.source.as_ref()) {
        Some(source) => load_scene(&model.config.data, model.config.seed, source)?,
        None if !model.folder.config_path().exists() => bail!(
            "{} has no config.toml that names its scene; give the scene folder with `--source`",
            model.folder.root().display()
        ),
        None => demo_scene(&records)?,
    };
    let split = |wanted: Split| {
        let named = records.iter().filter(|r| r.split == Some(wanted)).map(|r| &r.name);
        let found = named.map(|name| {
            let position = dataset.views.iter().position(|view| view.name == *name);
            position.with_context(|| format!("the scene has no photo `{name}` any more"))
        });
        found.collect::<Result<Vec<_>>>()
    };
    let (train, test) = (split(Split::Train)?, split(Split::Test)?);
    (dataset.train, dataset.test) = (train, test);
    Ok(dataset)
}

/// The demo scene in the size that the model's cameras have.
fn demo_scene(records: &[ibgs_core::train::output::cameras::CameraRecord]) -> Result<Dataset> {
    use ibgs_core::dataset::demo::{self, DemoOptions};
    let width = records.first().context("the model has no cameras")?.camera.width;
    let presets = [DemoOptions::small(), DemoOptions::large()];
    let preset = presets.into_iter().find(|p| p.width == width).context("the model's demo scene has another size")?;
    Ok(demo::load(&preset, None, true)?)
}
