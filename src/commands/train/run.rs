//! A training run with everything that it reports to.

use super::watch::{self, Watch};
use crate::commands::{protocol, score_test_views};
use anyhow::Result;
use ibgs_core::dataset::Dataset;
use ibgs_core::eval::Score;
use ibgs_core::gpu::Gpu;
use ibgs_core::raster::Rasterizer;
use ibgs_core::render::Renderer;
use ibgs_core::residual::weights;
use ibgs_core::scene::{Gaussians, PlyFlavor, write_ply};
use ibgs_core::train::Trainer;
use ibgs_core::train::config::{Method, TrainConfig};
use ibgs_core::train::output::OutputFolder;
use ibgs_core::train::output::figures::TIME_FILE;
use ibgs_core::train::output::log::{LogEntry, TrainingLog};
use ibgs_core::train::output::results::{ViewScore, means};
use ibgs_viewer::{Evaluation, Progress, Training};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A copy of the model comes to the host so often: what is left when the device is lost.
const COPY_EVERY: Duration = Duration::from_secs(60);

/// A model on the host.
struct Copy {
    iteration: u32,
    gaussians: Gaussians,
    network: Option<Vec<f32>>,
}

/// What is to be done after an iteration.
#[derive(Clone, Copy)]
struct Due {
    save: bool,
    evaluate: bool,
}

/// A training run with everything that it reports to.
pub struct Run {
    trainer: Trainer,
    raster: Arc<Rasterizer>,
    dataset: Dataset,
    config: TrainConfig,
    folder: OutputFolder,
    /// Time and memory of the iterations alone.
    watch: Watch,
    log: TrainingLog,
    evaluations: Vec<Evaluation>,
    /// The model some time ago.
    copy: Option<Copy>,
    copied: Option<Instant>,
    started: Instant,
}

impl Run {
    /// A run that has not begun; its preparations did at `started`.
    pub fn new(
        trainer: Trainer,
        raster: Arc<Rasterizer>,
        dataset: Dataset,
        config: TrainConfig,
        folder: OutputFolder,
        started: Instant,
    ) -> Self {
        let (watch, log) = (Watch::default(), TrainingLog::default());
        let (evaluations, copy) = (Vec::new(), None);
        Self { trainer, raster, dataset, config, folder, watch, log, evaluations, copy, copied: None, started }
    }

    /// The GPU that it trains on.
    pub fn gpu(&self) -> &Arc<Gpu> {
        self.raster.gpu()
    }

    /// The scene.
    pub fn dataset(&self) -> &Dataset {
        &self.dataset
    }

    /// The scene's folder; none of the built-in one.
    pub fn source(&self) -> Option<&Path> {
        self.config.data.source.as_deref()
    }

    /// Where it writes.
    pub fn folder(&self) -> &OutputFolder {
        &self.folder
    }

    /// Trains to the end, or until Ctrl-C.
    pub fn train(mut self) -> Result<()> {
        let stop = Arc::new(AtomicBool::new(false));
        let flag = stop.clone();
        // Only one handler a process; when there is one already (in tests), that one stays.
        let _ = ctrlc::set_handler(move || {
            if flag.swap(true, Ordering::SeqCst) {
                std::process::exit(130);
            }
        });
        let bar = progress_bar(self.config.iterations);
        while self.trainer.iteration() < self.config.iterations && !stop.load(Ordering::SeqCst) {
            let stepped = self.advance().and_then(|due| match due.save || due.evaluate {
                true => bar.suspend(|| self.settle(due)),
                false => Ok(()),
            });
            if let Err(error) = stepped {
                bar.finish_and_clear();
                return Err(self.rescue(error));
            }
            let iteration = self.trainer.iteration();
            bar.set_position(u64::from(iteration));
            if iteration.is_multiple_of(20) {
                self.report(&bar);
            }
        }
        bar.finish_and_clear();
        if stop.load(Ordering::SeqCst) {
            eprintln!("stopped at iteration {}: saving and evaluating", self.trainer.iteration());
        }
        self.finish()
    }

    /// One iteration.
    fn advance(&mut self) -> Result<Due> {
        let start = Instant::now();
        // What a lost device is asked for it often takes without a word.
        self.raster.gpu().check()?;
        self.trainer.step()?;
        let (iteration, schedule) = (self.trainer.iteration(), self.trainer.schedule());
        self.watch.count(schedule, iteration, self.raster.gpu());
        let due = Due { save: schedule.save_at(iteration), evaluate: schedule.evaluate_at(iteration) };
        if due.save || due.evaluate || watch::stage_ends(schedule, iteration) {
            self.raster.gpu().wait()?;
        }
        self.watch.spent(start.elapsed());
        self.note();
        if self.copied.is_none_or(|at| at.elapsed() >= COPY_EVERY) {
            self.copy = Some(self.to_host()?);
            self.copied = Some(Instant::now());
        }
        Ok(due)
    }

    /// Takes what the training tells into its log, which leaves out what it knows.
    fn note(&mut self) {
        let Progress { iteration, loss, psnr, gaussians, seconds, .. } = self.progress();
        if let (Some(loss), Some(psnr)) = (loss, psnr) {
            self.log.add(LogEntry { iteration, loss, psnr, gaussians, seconds });
        }
    }

    /// Saves and measures.
    fn settle(&mut self, due: Due) -> Result<()> {
        if due.save {
            self.write(&self.to_host()?)?;
        }
        if due.evaluate {
            self.evaluate()?;
        }
        Ok(self.folder.write_log(&self.log)?)
    }

    /// Saves what there is after an error, and says where it went.
    fn rescue(&self, error: anyhow::Error) -> anyhow::Error {
        let now = self.to_host().and_then(|model| self.write(&model));
        // A lost device gives nothing back any more.
        let saved = now.or_else(|error| self.copy.as_ref().map_or(Err(error), |copy| self.write(copy)));
        // The curves belong to a model; without them the error is told all the same.
        if saved.is_ok() {
            let _ = self.folder.write_log(&self.log);
        }
        match saved {
            Ok(path) => error.context(format!("training stopped; the model so far is in {}", path.display())),
            Err(_) => error,
        }
    }

    fn report(&self, bar: &ProgressBar) {
        let Progress { loss, psnr, gaussians, .. } = self.progress();
        if let (Some(loss), Some(psnr)) = (loss, psnr) {
            bar.set_message(format!("loss {loss:.4}  PSNR {psnr:5.2}  {gaussians} Gaussians"));
        }
    }

    fn to_host(&self) -> Result<Copy> {
        let renderer = self.trainer.renderer();
        let network = renderer.part().map(|part| part.network.to_values()).transpose()?;
        let gaussians = self.trainer.splats().download()?;
        // What is read from a lost device looks like any other answer.
        self.raster.gpu().check()?;
        Ok(Copy { iteration: self.trainer.iteration(), gaussians, network })
    }

    fn write(&self, model: &Copy) -> Result<PathBuf> {
        // Without planes the file is exactly what other programs write and read.
        let planes = self.config.method == Method::Ibgs;
        let flavor = if planes { PlyFlavor::Full } else { PlyFlavor::Plain };
        // The network first: a folder holds a model once it holds its Gaussians, and never a model without its network.
        if let Some(network) = &model.network {
            weights::write(&self.folder.network_save_path(model.iteration), network)?;
        }
        let path = self.folder.point_cloud_path(model.iteration);
        write_ply(&path, &model.gaussians, flavor)?;
        Ok(path)
    }

    fn evaluate(&mut self) -> Result<()> {
        let iteration = self.trainer.iteration();
        if self.dataset.test.is_empty() {
            return Ok(());
        }
        let renderer = self.trainer.renderer();
        let target = (&self.folder, iteration);
        let scores = score_test_views(&renderer, &self.dataset, &self.config, target, None, |_, _| {})?;
        scores.write(&self.folder, iteration, &protocol(&self.config, &self.dataset, self.raster.gpu()))?;
        let ms = 1e3 * self.watch.total().as_secs_f64() / f64::from(iteration.max(1));
        eprintln!(
            "iteration {iteration}: test {} over {} views; {} Gaussians, {ms:.2} ms an iteration so far",
            scores.sentence(),
            scores.base.len(),
            self.trainer.splats().len()
        );
        if let Some(sentence) = scores.regions_sentence() {
            eprintln!("   {sentence}");
        }
        let mean = |scores: &[ViewScore]| -> Option<Score> { (!scores.is_empty()).then(|| means(scores)) };
        self.evaluations.extend(mean(&scores.base).map(|base| Evaluation {
            iteration,
            gaussians: self.trainer.splats().len(),
            base,
            image: mean(&scores.image),
        }));
        Ok(())
    }

    /// Writes how long the training took, for `ibgs eval`.
    fn write_time(&self) -> Result<()> {
        let time = json!({
            "seconds": self.watch.total().as_secs_f64(),
            "iterations": self.trainer.iteration(),
            "stages": self.watch.json(),
            "device": self.raster.gpu().describe(),
        });
        Ok(self.folder.write_result(self.trainer.iteration(), TIME_FILE, time)?)
    }
}

impl Training for Run {
    fn step(&mut self, told: &dyn Fn(&str)) -> Result<()> {
        let stepped = self.advance().and_then(|due| {
            if due.evaluate {
                told("measuring on the held-out views");
            } else if due.save {
                told("saving");
            }
            self.settle(due)
        });
        stepped.map_err(|error| self.rescue(error))
    }

    fn progress(&self) -> Progress {
        let telemetry = self.trainer.telemetry();
        // Until something has come back from the GPU both are zero.
        let known = telemetry.stats.loss != 0.0;
        Progress {
            iteration: self.trainer.iteration(),
            iterations: self.config.iterations,
            stage: watch::stage(self.trainer.schedule(), self.trainer.iteration().max(1)),
            loss: known.then_some(telemetry.stats.loss),
            psnr: known.then(|| telemetry.stats.psnr()),
            gaussians: self.trainer.splats().len(),
            seconds: self.watch.total().as_secs_f64(),
            evaluations: self.evaluations.clone(),
        }
    }

    fn renderer(&self) -> Renderer {
        self.trainer.renderer().showing_surface()
    }

    fn save(&mut self) -> Result<PathBuf> {
        self.write(&self.to_host()?)
    }

    fn finish(&mut self) -> Result<()> {
        let (iteration, schedule) = (self.trainer.iteration(), self.trainer.schedule());
        if iteration == 0 {
            return Ok(());
        }
        // One that was stopped in between.
        let save = !schedule.save_at(iteration);
        let evaluate = self.evaluations.last().is_none_or(|last| last.iteration != iteration);
        self.settle(Due { save, evaluate })?;
        if self.trainer.overflowed() {
            eprintln!("note: some iterations had more tile intersections than there was room for, and were left out");
        }
        self.write_time()?;
        eprintln!(
            "trained {iteration} iterations in {:.1} s (start-up, evaluation and saving {:.1} s more); {} Gaussians",
            self.watch.total().as_secs_f64(),
            self.started.elapsed().saturating_sub(self.watch.total()).as_secs_f64(),
            self.trainer.splats().len()
        );
        eprintln!("stages: {}", self.watch.sentence());
        Ok(())
    }
}

fn progress_bar(iterations: u32) -> ProgressBar {
    let bar = ProgressBar::new(u64::from(iterations));
    let style = "{bar:28} {pos}/{len}  {msg}  {per_sec} {eta} left";
    bar.set_style(ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}
