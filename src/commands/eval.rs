//! `ibgs eval`

use super::model::ModelArgs;
use super::{Model, protocol, score_test_views};
use anyhow::{Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::camera::Camera;
use ibgs_core::eval::{Cache, PASSES, Score, ViewScores, frames_per_second};
use ibgs_core::train::output::cameras::Split;
use ibgs_core::train::output::results::means;
use serde_json::{Value, json};
use std::path::Path;

/// Options of `ibgs eval`.
#[derive(ClapArgs)]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let mut model = Model::open(&args.model)?;
    let dataset = model.dataset(&args.model)?.clone();
    if dataset.test.is_empty() {
        bail!("the scene has no held-out views; train with `--eval`");
    }
    let with_final = model.renderer.part().is_some();
    row("view", ["base PSNR", "SSIM", "final PSNR", "SSIM"].map(str::to_owned), with_final);
    let target = (&model.folder, model.iteration);
    let scores = score_test_views(&model.renderer, &dataset, &model.config, target, |name, scores| {
        row(name, cells(scores), with_final);
    })?;
    let image = with_final.then(|| means(&scores.image));
    row("mean", cells(&ViewScores { base: means(&scores.base), image }), with_final);
    scores.write(&model.folder, model.iteration, &protocol(&model.config, &dataset, model.renderer.gpu()))?;
    let cameras: Vec<Camera> = dataset.test.iter().map(|&i| dataset.views[i].camera).collect();
    let report = report(&model, &cameras, photo_bytes(&model, &dataset.path))?;
    println!("{}", serde_json::to_string_pretty(&report)?);
    if let Some(sentence) = scores.regions_sentence() {
        println!("{sentence}");
    }
    println!("LPIPS not computed");
    Ok(model.folder.write_result(model.iteration, "result_fps_mem.json", report)?)
}

fn cells(scores: &ViewScores) -> [String; 4] {
    let none = || [String::new(), String::new()];
    let two = |score: Score| [format!("{:.3}", score.psnr), format!("{:.4}", score.ssim)];
    let ([a, b], [c, d]) = (two(scores.base), scores.image.map_or_else(none, two));
    [a, b, c, d]
}

fn row(name: &str, [a, b, c, d]: [String; 4], with_final: bool) {
    match with_final {
        true => println!("{name:<32} {a:>10} {b:>8} {c:>11} {d:>8}"),
        false => println!("{name:<32} {a:>10} {b:>8}"),
    }
}

/// Speed, memory and storage.
fn report(model: &Model, cameras: &[Camera], photos: Option<u64>) -> Result<Value> {
    let renderer = &model.renderer;
    let warm = frames_per_second(renderer, cameras, Cache::Warm)?;
    let memory = renderer.gpu().memory_report().map(|report| report.reserved_bytes);
    let network = model.network_bytes;
    // A bundle is one file; the folder beside it may hold another model.
    let size = |path: &Path| path.metadata().ok().filter(|_| model.bundle_bytes.is_none()).map(|file| file.len());
    let gaussians = size(&model.folder.point_cloud_path(model.iteration));
    let poses = size(&model.folder.cameras_path());
    let bundle = model.bundle_bytes;
    let training = std::fs::read_to_string(model.folder.root().join("result_training.json")).ok();
    let training: Option<Value> = training.and_then(|text| serde_json::from_str(&text).ok());
    let mut report = json!({
        "FPS_warm": warm,
        "least_passes": PASSES,
        "gaussians": renderer.splats().len(),
        "storage_bytes": {
            "gaussians": gaussians, "network": network, "poses": poses, "photos": photos, "bundle": bundle,
        },
        "memory_reserved_bytes": memory,
        "training": training.as_ref().and_then(|t| t.get(format!("ours_{}", model.iteration))),
        "device": renderer.gpu().describe(),
    });
    if renderer.part().is_some() {
        report["FPS_cold"] = json!(frames_per_second(renderer, cameras, Cache::Cold)?);
    }
    Ok(report)
}

/// Bytes of the training photos' files; none where one is not found.
fn photo_bytes(model: &Model, scene: &Path) -> Option<u64> {
    let folder = model.config.data.images.clone().unwrap_or_else(|| "images".to_owned());
    let size = |name: &str| {
        let candidates = [scene.join(&folder).join(name), scene.join(name)];
        candidates.iter().find_map(|path| path.metadata().ok()).map(|file| file.len())
    };
    model.cameras.iter().filter(|r| r.split != Some(Split::Test)).map(|r| size(&r.name)).sum()
}
