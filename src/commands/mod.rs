//! One module a command: parse, call the core, print.

pub mod bench;
pub mod compare;
pub mod completions;
pub mod eval;
pub mod export;
pub mod info;
pub mod man;
pub mod mesh;
mod model;
mod outputs;
pub mod render;
pub mod report;
pub mod suite;
pub mod train;
pub mod view;

pub use model::Model;
pub use outputs::{Output, Place};

use anyhow::Result;
use ibgs_core::dataset::demo::{self, DemoOptions};
use ibgs_core::dataset::{self, Dataset, LoadOptions, Masks, View};
use ibgs_core::eval::lpips::Lpips;
use ibgs_core::eval::{Region, Score, ViewScores, score_view};
use ibgs_core::gpu::{AdapterChoice, Gpu};
use ibgs_core::render::{Frame, Renderer};
use ibgs_core::tell;
use ibgs_core::train::config::TrainConfig;
use ibgs_core::train::output::OutputFolder;
use ibgs_core::train::output::cameras::Split;
use ibgs_core::train::output::results::{Protocol, Scored, ViewScore, means};
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Signals within so long after the first one are that one again: a terminal, `timeout` or a scheduler may send it to the
/// process and to its group.
const SAME_SIGNAL: Duration = Duration::from_secs(1);

/// Does something at the first Ctrl-C, SIGTERM or closed terminal; at a later one the program ends at once.
pub fn on_stop(first: impl Fn() + Send + 'static) {
    let mut stopping = None;
    // Only one handler a process; when there is one already (in tests), that one stays.
    let _ = ctrlc::set_handler(move || match stopping {
        None => {
            stopping = Some(Instant::now());
            first();
        }
        Some(begun) if begun.elapsed() > SAME_SIGNAL => end_now(),
        Some(_) => {}
    });
}

/// Ends the program without the cleaning up of an orderly exit, in which drivers crash while other threads use them.
#[cfg(unix)]
fn end_now() {
    use rustix::process::{Signal, getpid, kill_process};
    let _ = kill_process(getpid(), Signal::KILL);
}

/// Ends the program.
#[cfg(not(unix))]
fn end_now() {
    std::process::exit(130);
}

/// Opens the adapter that `--adapter` names.
pub fn open_gpu(adapter: Option<&String>) -> Result<Arc<Gpu>> {
    let choice = adapter.map_or(AdapterChoice::Best, |name| AdapterChoice::Named(name.clone()));
    let gpu = Gpu::open(&choice)?;
    tell!("adapter: {}", gpu.describe());
    Ok(gpu)
}

/// Loads the scene that a run was configured with, from `source`.
pub fn load_scene(config: &TrainConfig, source: &Path) -> Result<Dataset> {
    let data = &config.data;
    let options = LoadOptions {
        resolution: data.resolution.parse()?,
        resampler: data.resampler.parse()?,
        images: data.images.clone(),
        max_resolution: data.max_resolution,
        eval: data.eval,
        eval_split_every: data.eval_split_every as usize,
        principal_point: data.principal_point.parse()?,
        masks: data.masks,
        alpha: data.alpha,
        // What lies under transparent photos is what lies behind the Gaussians.
        background: config.background().map(|v| (v * 255.0).round() as u8),
        color_space: data.color_space,
        filter_points: data.filter_points,
        seed: config.seed,
        random_points: data.random_points as usize,
        progress: true,
    };
    let dataset = dataset::load(source, &options)?;
    for note in &dataset.notes {
        tell!("note: {note}");
    }
    Ok(dataset)
}

/// Loads the demo scene; with a seed every photo has another exposure.
pub fn load_demo(options: &DemoOptions, exposure_seed: Option<u64>) -> Result<Dataset> {
    let mut dataset = demo::load(options, None, true)?;
    if let Some(seed) = exposure_seed {
        demo::change_exposure(&mut dataset, seed);
    }
    Ok(dataset)
}

/// A view with its photo as figures compare with it: that of an object lies over the run's background.
pub fn compared<'a>(view: &'a View, config: &TrainConfig) -> Cow<'a, View> {
    match config.data.masks {
        Masks::Ignore => Cow::Borrowed(view),
        Masks::Object => {
            let photo = Arc::new(view.photo.over(config.background()));
            Cow::Owned(View { photo, ..view.clone() })
        }
    }
}

/// Renders every held-out view into the model folder, and scores it, with a network by LPIPS too. `told` hears of each.
pub fn score_test_views(
    renderer: &Renderer,
    dataset: &Dataset,
    config: &TrainConfig,
    (folder, iteration): (&OutputFolder, u32),
    lpips: Option<&Lpips>,
    told: impl Fn(&str, &ViewScores),
) -> Result<Scores> {
    let mut scores = Scores::default();
    // Without a source it is the built-in scene.
    let is_demo = config.data.source.is_none();
    for view in dataset.test.iter().map(|&index| compared(&dataset.views[index], config)) {
        let view = &*view;
        let (frame, scored) = score_view(renderer, view, lpips)?;
        let place = Place { folder, split: Split::Test, iteration, name: &view.name };
        place.write_outputs(&frame, &Output::of(renderer))?;
        place.write_photo(&view.photo)?;
        if is_demo {
            scores.add_regions(&frame, view)?;
        }
        told(&view.name, &scored);
        let named = |Score { psnr, aligned_psnr, ssim, lpips }: Score| ViewScore {
            name: view.name.clone(),
            psnr,
            aligned_psnr,
            ssim,
            lpips,
        };
        scores.base.push(named(scored.base));
        scores.image.extend(scored.image.map(named));
    }
    Ok(scores)
}

/// Scores of all held-out views.
#[derive(Default)]
pub struct Scores {
    /// Of the base images.
    pub base: Vec<ViewScore>,
    /// Of the final images; empty where the model has no network.
    pub image: Vec<ViewScore>,
    /// Of the demo scene, whose objects are known: base and final image on its glossy and mirror-like objects, then
    /// elsewhere.
    pub regions: Option<[[Region; 2]; 2]>,
}

impl Scores {
    /// Writes them into the model folder.
    pub fn write(&self, folder: &OutputFolder, iteration: u32, protocol: &Protocol) -> Result<()> {
        folder.write_results(iteration, Scored::Base, &self.base, protocol)?;
        if !self.image.is_empty() {
            folder.write_results(iteration, Scored::Final, &self.image, protocol)?;
        }
        Ok(())
    }

    /// Errors on the demo scene's glossy and mirror-like objects and elsewhere.
    fn add_regions(&mut self, frame: &Frame, view: &View) -> Result<()> {
        let objects = demo::truth(&view.camera).object;
        let regions = self.regions.get_or_insert_default();
        let images = [Some(frame.base()?), frame.image()?];
        for (place, wanted) in regions.iter_mut().zip([true, false]) {
            for (region, image) in place.iter_mut().zip(&images) {
                if let Some(image) = image {
                    region.add(image, &view.photo, |i| demo::is_view_dependent(objects[i]) == wanted);
                }
            }
        }
        Ok(())
    }

    /// `glossy objects: final 25.10 dB, base 23.00 dB; elsewhere: ...`, where the scene's objects are known.
    pub fn regions_sentence(&self) -> Option<String> {
        let [glossy, elsewhere] = self.regions?;
        let one = |[base, image]: [Region; 2]| match self.image.is_empty() {
            true => format!("{:.2} dB", base.psnr()),
            false => format!("final {:.2} dB, base {:.2} dB", image.psnr(), base.psnr()),
        };
        Some(format!("glossy and mirror-like objects: {}; elsewhere: {}", one(glossy), one(elsewhere)))
    }

    /// `PSNR 29.9 dB, SSIM 0.84`, of the base image too where there is a final one.
    pub fn sentence(&self) -> String {
        let one = |scores: &[ViewScore]| {
            let Score { psnr, ssim, .. } = means(scores);
            format!("PSNR {psnr:.3} dB, SSIM {ssim:.4}")
        };
        match self.image.is_empty() {
            true => one(&self.base),
            false => format!("final {}, base {}", one(&self.image), one(&self.base)),
        }
    }
}

/// What the figures of a run depend on.
pub fn protocol(config: &TrainConfig, dataset: &Dataset, gpu: &Gpu) -> Protocol {
    let resized = config.data.resolution != "1" || config.data.max_resolution.is_some();
    Protocol {
        resampler: match resized {
            true => format!("{}, or the scene's own reduced photos", config.data.resampler),
            false => "none".to_owned(),
        },
        factor: config.data.resolution.clone(),
        split: format!("{} of {} views, listed in split.json", dataset.test.len(), dataset.views.len()),
        principal_point: config.data.principal_point.clone(),
        masks: match (config.data.masks, config.white_background) {
            (Masks::Ignore, _) => "ignore",
            (Masks::Object, false) => "object, photos over black",
            (Masks::Object, true) => "object, photos over white",
        }
        .to_owned(),
        device: gpu.describe(),
        lpips: None,
    }
}
