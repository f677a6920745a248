//! `ibgs eval`

use super::model::{ModelArgs, OpenModel};
use super::report::{Report, costs};
use crate::progress::{Bars, bar, spinner};
use crate::stderr;
use crate::stdout;
use anyhow::{Context, Result, bail};
use clap::{Args as ClapArgs, ValueEnum};
use ibgs_core::camera::Camera;
use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::{Dataset, View};
use ibgs_core::eval::fitted::fitted_views;
use ibgs_core::eval::scores::{Scores, protocol, score_test_views};
use ibgs_core::eval::true_cameras::TrueCameras;
use ibgs_core::eval::{Cache, PASSES, Perceptual, Score, ViewScores, frames_per_second};
use ibgs_core::model::load_scene;
use ibgs_core::output::REPORT_FILE;
use ibgs_core::output::figures::{Figures, SPEED_FILE, TIME_FILE};
use ibgs_core::output::results::{Protocol, ViewScore, means};
use ibgs_train::lpips::{BAND_BYTES, InputRange, Lpips, LpipsWeights};
use indicatif::ProgressBar;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Range of the values that LPIPS' network reads.
#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum LpipsRange {
    /// Mapped to -1..1, as the `lpips` package expects.
    #[default]
    Signed,
    /// Left in 0..1, as in published figures of Gaussian splatting.
    Published,
}

impl From<LpipsRange> for InputRange {
    fn from(range: LpipsRange) -> Self {
        match range {
            LpipsRange::Signed => Self::Signed,
            LpipsRange::Published => Self::Published,
        }
    }
}

const EXAMPLES: &str = "\
Example:
  ibgs eval output/my-scene --lpips-weights lpips_vgg.pth";

/// Options of `ibgs eval`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// Also measure LPIPS (VGG) with these weights, `.pth` or `.safetensors`: the state dict of the `lpips` package's
    /// LPIPS(net='vgg'), or two files, torchvision's vgg16 and the package's vgg.pth.
    #[arg(long, value_name = "FILE", num_args = 1..=2)]
    lpips_weights: Vec<PathBuf>,
    /// Range of the values that LPIPS reads.
    #[arg(long, value_enum, default_value_t, requires = "lpips_weights")]
    lpips_range: LpipsRange,
    /// Also fit the camera of each held-out view to its own photo, and report the PSNR from there apart: PSNR_fitted_pose.
    #[arg(long)]
    fit_poses: bool,
    /// Also render the held-out views with the cameras that this scene has for their photos, after the similarity that fits
    /// the model's training cameras to its own, and report the PSNR there apart: PSNR_true_cameras.
    #[arg(long, value_name = "SCENE")]
    true_cameras: Option<PathBuf>,
    /// HTML file for the report: figures, curves and pictures [default: MODEL/report.html].
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let weights = Some(&args.lpips_weights).filter(|files| !files.is_empty());
    let weights = weights.map(|files| LpipsWeights::load(files)).transpose()?;
    if let Some(path) = args.report.as_ref().filter(|path| path.is_dir()) {
        bail!("the report cannot replace the folder {}; give `--report` a file", path.display());
    }
    let mut model = args.model.open()?;
    let dataset = model.dataset(&Bars::default())?.clone();
    if dataset.test.is_empty() {
        bail!("the scene has no held-out views; train with `--eval`");
    }
    let truth = args.true_cameras.as_ref();
    let truth = truth.map(|scene| true_cameras(&model.config, &dataset, scene)).transpose()?;
    // Measured first, so that the memory of LPIPS does not count as the model's.
    let cameras: Vec<Camera> = dataset.test.iter().map(|&i| dataset.views[i].camera).collect();
    let speed = speed(&model, &cameras, photo_bytes(&model, &dataset.path))?;
    let lpips = |weights| Lpips::new(model.renderer.gpu().clone(), &weights, args.lpips_range.into(), BAND_BYTES);
    let lpips = weights.map(lpips).transpose()?;
    let table = Table {
        with_final: model.renderer.part().is_some(),
        with_lpips: lpips.is_some(),
        bar: bar("measuring", cameras.len()),
    };
    table.head();
    let into = Some((&model.folder, model.iteration));
    let perceptual = lpips.as_ref().map(|lpips| lpips as &dyn Perceptual);
    let report = &mut |name: &str, scores: Option<&ViewScores>| {
        table.row(name, scores);
        table.bar.inc(1);
    };
    let mut scores = score_test_views(&model.renderer, &dataset, &model.config, into, perceptual, report)?;
    table.bar.finish_and_clear();
    table.row("mean", mean(&scores).as_ref());
    if args.fit_poses {
        let bar = bar("fitting poses", cameras.len());
        scores.fitted = fitted_views(&model.renderer, &dataset, &model.config, &mut |_| bar.inc(1))?;
        bar.finish_and_clear();
    }
    let mut protocol = protocol(&model.config, &dataset, model.renderer.gpu());
    protocol.lpips = lpips.as_ref().map(|lpips| lpips.range().describe().to_owned());
    scores.write(&model.folder, model.iteration, &protocol)?;
    model.folder.write_result(model.iteration, SPEED_FILE, speed)?;
    let there = truth.map(|truth| score_true_cameras(&model, &truth)).transpose()?.flatten();
    let figures = Figures::read(&model.folder, model.iteration)?;
    stdout!();
    let costs = costs(figures.speed.as_ref(), figures.time.as_ref());
    let width = costs.iter().map(|(name, _)| name.chars().count()).max().unwrap_or_default();
    costs.iter().for_each(|(name, value)| stdout!("{name:<width$}  {value}"));
    stdout!();
    notes(&model, &dataset, &scores, &protocol)?.iter().chain(&there).for_each(|note| stdout!("{note}"));
    write_report(args, &model, &dataset, &figures)
}

/// The held-out views where another scene has their cameras.
fn true_cameras(config: &TrainConfig, dataset: &Dataset, scene: &Path) -> Result<TrueCameras> {
    let truth = load_scene(config, scene, &Bars::default())?;
    TrueCameras::new(dataset, truth).context("option `--true-cameras`")
}

/// Scores these; the sentence about them.
fn score_true_cameras(model: &OpenModel, truth: &TrueCameras) -> Result<Option<String>> {
    let bar = bar("measuring at the true cameras", truth.dataset.test.len());
    let scores = score_test_views(&model.renderer, &truth.dataset, &model.config, None, None, &mut |_, _| bar.inc(1))?;
    bar.finish_and_clear();
    truth.write(&scores, &model.folder, model.iteration)?;
    Ok(truth.sentence(&scores))
}

/// Means of the views that have scores; none without any.
fn mean(scores: &Scores) -> Option<ViewScores> {
    let of = |scores: &[ViewScore]| (!scores.is_empty()).then(|| means(scores));
    Some(ViewScores { base: of(&scores.base)?, image: of(&scores.image) })
}

/// What else there is to know about the scores.
fn notes(model: &OpenModel, dataset: &Dataset, scores: &Scores, protocol: &Protocol) -> Result<Vec<String>> {
    let mut notes = Vec::new();
    notes.extend(scores.regions_sentence());
    if let (Some(_), Some(mean)) = (model.exposure_field()?, mean(scores)) {
        let image = mean.image.map_or_else(String::new, |score| format!("final {:.3} dB, ", score.aligned_psnr));
        notes.push(format!(
            "exposure: corrected; each view has the one predicted from the photos around it. After an affine map of the colours: \
             {image}base {:.3} dB",
            mean.base.aligned_psnr
        ));
    }
    let masked = scores.with_masks;
    if model.config.data.shows_object() {
        notes.push(format!("masks: {}", protocol.masks));
    } else if masked > 0 {
        let all = dataset.test.len();
        notes.push(format!("masks: masked pixels and blank edges of undistorted photos do not count; {masked} of {all} photos have some"));
    }
    notes.extend(scores.masked_sentence());
    notes.extend(scores.fitted_sentence());
    notes.push(match &protocol.lpips {
        Some(how) => format!("LPIPS: {how}"),
        None => "LPIPS not computed (`--lpips-weights` names its weights)".to_owned(),
    });
    Ok(notes)
}

fn write_report(args: &Args, model: &OpenModel, dataset: &Dataset, figures: &Figures) -> Result<()> {
    let path = args.report.clone().unwrap_or_else(|| model.folder.root().join(REPORT_FILE));
    let views: Vec<&View> = dataset.test.iter().map(|&index| &dataset.views[index]).collect();
    let report = Report {
        name: &args.model.files.model.display().to_string(),
        folder: &model.folder,
        figures,
        views: &views,
        config: &model.config,
    };
    report.write(&path)?;
    stderr!("report: {}", path.display());
    Ok(())
}

/// The printed table of scores, above a bar.
struct Table {
    with_final: bool,
    with_lpips: bool,
    bar: ProgressBar,
}

impl Table {
    fn head(&self) {
        let titles = |psnr: &str| [psnr, "SSIM", "LPIPS"].map(str::to_owned);
        self.line("view", &titles("base PSNR"), &titles("final PSNR"));
    }

    fn row(&self, name: &str, scores: Option<&ViewScores>) {
        let cells = |score: Option<Score>| match score {
            Some(score) => {
                let lpips = score.lpips.map_or_else(|| "-".to_owned(), |lpips| format!("{lpips:.4}"));
                [format!("{:.3}", score.psnr), format!("{:.4}", score.ssim), lpips]
            }
            None => ["-"; 3].map(str::to_owned),
        };
        self.line(name, &cells(scores.map(|scores| scores.base)), &cells(scores.and_then(|scores| scores.image)));
    }

    fn line(&self, name: &str, base: &[String; 3], image: &[String; 3]) {
        let mut line = format!("{name:<32}");
        for [psnr, ssim, lpips] in [base, image].into_iter().take(if self.with_final { 2 } else { 1 }) {
            line += &format!(" {psnr:>11} {ssim:>8}");
            if self.with_lpips {
                line += &format!(" {lpips:>8}");
            }
        }
        self.bar.suspend(|| stdout!("{line}"));
    }
}

/// Measures speed, memory and storage.
fn speed(model: &OpenModel, cameras: &[Camera], photos: Option<u64>) -> Result<Value> {
    let renderer = &model.renderer;
    let spinner = spinner("measuring frames per second");
    let warm = frames_per_second(renderer, cameras, Cache::Warm)?;
    let memory = renderer.gpu().memory_report().map(|report| report.reserved_bytes);
    let network = model.network_bytes;
    // A bundle is one file; the folder beside it may hold another model.
    let size = |path: &Path| path.metadata().ok().filter(|_| model.bundle_bytes.is_none()).map(|file| file.len());
    let gaussians = model.cloud_bytes();
    let members: usize = renderer.members().iter().map(|member| member.splats().len()).sum();
    let poses = size(&model.folder.cameras_path());
    let bundle = model.bundle_bytes;
    let training = std::fs::read_to_string(model.folder.root().join(TIME_FILE)).ok();
    let training: Option<Value> = training.and_then(|text| serde_json::from_str(&text).ok());
    let mut report = json!({
        "FPS_warm": warm,
        "least_passes": PASSES,
        "gaussians": members + model.levels.as_ref().map_or(renderer.splats().len(), |levels| levels.len()),
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
    spinner.finish_and_clear();
    Ok(report)
}

/// Size of the training photos' files in bytes; none if one is missing.
fn photo_bytes(model: &OpenModel, scene: &Path) -> Option<u64> {
    let folder = model.config.data.images.clone().unwrap_or_else(|| "images".to_owned());
    let size = |name: &str| {
        let candidates = [scene.join(&folder).join(name), scene.join(name)];
        candidates.iter().find_map(|path| path.metadata().ok()).map(|file| file.len())
    };
    model.training_views().iter().map(|r| size(&r.name)).sum()
}
