//! A training run with everything that it reports to.

use super::keeper::Keeper;
use super::watch::{self, Watch};
use crate::commands::{on_stop, protocol, score_test_views};
use anyhow::{Context, Result};
use ibgs_core::dataset::Dataset;
use ibgs_core::eval::Score;
use ibgs_core::exposure::{Exposure, ExposureField};
use ibgs_core::gpu::Gpu;
use ibgs_core::raster::Rasterizer;
use ibgs_core::render::Renderer;
use ibgs_core::residual::weights;
use ibgs_core::scene::{Gaussians, PlyFlavor, write_ply};
use ibgs_core::tell;
use ibgs_core::train::checkpoint::Checkpoint;
use ibgs_core::train::config::{ExposureSwitch, Method, TrainConfig};
use ibgs_core::train::output::OutputFolder;
use ibgs_core::train::output::figures::TIME_FILE;
use ibgs_core::train::output::log::{LogEntry, TrainingLog};
use ibgs_core::train::output::results::{ViewScore, means};
use ibgs_core::train::{TrainError, Trainer};
use ibgs_viewer::{Evaluation, Progress, Training};
use indicatif::{ProgressBar, ProgressStyle};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Part of the learning rates that counts after a value was no number.
const CAUTION: f64 = 0.5;

/// What a run keeps beside its training; checkpoints hold it too.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
struct Records {
    /// Time and memory of the iterations alone.
    watch: Watch,
    log: TrainingLog,
    evaluations: Vec<Evaluation>,
}

/// What is to be done after an iteration.
#[derive(Clone, Copy)]
struct Due {
    save: bool,
    evaluate: bool,
    /// The state is to be taken, and written.
    keep: bool,
    write: bool,
}

/// A training run with everything that it reports to.
pub struct Run {
    trainer: Trainer,
    raster: Arc<Rasterizer>,
    dataset: Dataset,
    config: TrainConfig,
    folder: OutputFolder,
    records: Records,
    keeper: Keeper,
    started: Instant,
    /// Time of the iterations before a resumed run.
    before: Duration,
}

impl Run {
    /// A run that has not begun; its preparations did at `started`. A checkpoint is written `every` so often; none: only
    /// when the run is stopped.
    pub fn new(
        trainer: Trainer,
        raster: Arc<Rasterizer>,
        dataset: Dataset,
        config: TrainConfig,
        folder: OutputFolder,
        every: Option<Duration>,
        started: Instant,
    ) -> Self {
        let (records, keeper) = (Records::default(), Keeper::new(folder.clone(), every));
        Self { trainer, raster, dataset, config, folder, records, keeper, started, before: Duration::ZERO }
    }

    /// The same with the records of a checkpoint that it goes on from.
    pub fn with_records_of(mut self, checkpoint: &Checkpoint) -> Self {
        self.keeper.resumed(checkpoint.iteration());
        match Records::deserialize(&checkpoint.run) {
            Ok(records) => (self.before, self.records) = (records.watch.total(), records),
            Err(error) => tell!("note: times and curves of the iterations before are lost ({error})"),
        }
        self
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
        on_stop(move || flag.store(true, Ordering::SeqCst));
        let bar = progress_bar(self.config.iterations);
        while self.trainer.iteration() < self.config.iterations && !stop.load(Ordering::SeqCst) {
            let stepped = self.advance().and_then(|due| match due.save || due.evaluate {
                true => bar.suspend(|| self.follow(due)),
                false => self.follow(due),
            });
            if let Err(error) = stepped.or_else(|error| bar.suspend(|| self.go_back(error))) {
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
            tell!("stopped at iteration {}: saving and evaluating", self.trainer.iteration());
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
        self.records.watch.count(schedule, iteration, self.raster.gpu());
        let (save, evaluate) = (schedule.save_at(iteration), schedule.evaluate_at(iteration));
        let (keep, write) = self.keeper.due();
        // The first iteration of a stage asks for more memory, which may not be there. After the last one there is nothing to go
        // on with.
        let keep = (keep || watch::stage_ends(schedule, iteration)) && iteration < self.config.iterations;
        let due = Due { save, evaluate, keep, write };
        // What is still at work belongs to the iterations, and not to what follows; the last one is saved.
        if save || evaluate || keep {
            self.raster.gpu().wait()?;
        }
        self.records.watch.spent(start.elapsed());
        self.note();
        Ok(due)
    }

    /// Does what is due after an iteration, and then keeps the state: a resumed run does nothing of the rest.
    fn follow(&mut self, due: Due) -> Result<()> {
        if due.save || due.evaluate {
            self.settle(due.save, due.evaluate)?;
        }
        if due.keep { self.keep(due.write) } else { Ok(()) }
    }

    /// Takes the state as it is now, and begins to write it where that is wanted.
    fn keep(&mut self, write: bool) -> Result<()> {
        if self.trainer.iteration() > 0 {
            let start = Instant::now();
            let checkpoint = self.trainer.checkpoint(serde_json::to_value(&self.records)?)?;
            self.keeper.take(checkpoint, write, start.elapsed());
        }
        Ok(())
    }

    /// After a value that was no number: back to the last good state, once, and on with lower rates.
    fn go_back(&mut self, error: anyhow::Error) -> Result<()> {
        let broken = matches!(error.downcast_ref::<TrainError>(), Some(TrainError::NotFinite(_)));
        let Some(checkpoint) = self.keeper.last().filter(|_| broken && !self.trainer.is_slowed()).cloned() else {
            return Err(error);
        };
        tell!(
            "warning: {error}; going back to iteration {}, once, with {CAUTION} times the learning rates",
            checkpoint.iteration()
        );
        self.trainer.restore(&checkpoint)?;
        self.trainer.slow_down(CAUTION);
        self.keeper.went_back();
        self.records = Records::deserialize(&checkpoint.run)?;
        Ok(())
    }

    /// Takes what the training tells into its log, which leaves out what it knows.
    fn note(&mut self) {
        let Progress { iteration, loss, psnr, gaussians, seconds, .. } = self.progress();
        if let (Some(loss), Some(psnr)) = (loss, psnr) {
            self.records.log.add(LogEntry { iteration, loss, psnr, gaussians, seconds });
        }
    }

    /// Saves and measures.
    fn settle(&mut self, save: bool, evaluate: bool) -> Result<()> {
        if save {
            // What a checkpoint takes of a small disk while it is written must not be missed here.
            self.keeper.settle();
            self.save()?;
        }
        if evaluate {
            self.evaluate()?;
        }
        Ok(self.folder.write_log(&self.records.log)?)
    }

    /// Saves what there is after an error, and says where it went.
    fn rescue(&mut self, error: anyhow::Error) -> anyhow::Error {
        // A lost device gives nothing back any more, and what is no number is no state to go on from: then the last good
        // one is what there is.
        let _ = self.keep(false);
        let Some(checkpoint) = self.keeper.last().cloned() else { return error };
        let network = checkpoint.network.as_ref().map(|network| &network.weights[..]);
        let exposure = checkpoint.exposures();
        let saved = self.write(checkpoint.iteration(), &checkpoint.gaussians, network, exposure.as_deref());
        // Without the curves the error is told all the same.
        if saved.is_ok() {
            let _ = self.folder.write_log(&self.records.log);
        }
        let resumed = self.keeper.write();
        let there = match (saved, resumed) {
            (Ok(path), Ok(())) => {
                format!("the model so far is in {}, and `--resume` goes on from there", path.display())
            }
            (Ok(path), Err(_)) => format!("the model so far is in {}", path.display()),
            (Err(_), Ok(())) => format!("`--resume` goes on from iteration {}", checkpoint.iteration()),
            (Err(_), Err(_)) => return error,
        };
        error.context(format!("training stopped; {there}"))
    }

    fn report(&self, bar: &ProgressBar) {
        let Progress { loss, psnr, gaussians, .. } = self.progress();
        if let (Some(loss), Some(psnr)) = (loss, psnr) {
            bar.set_message(format!("loss {loss:.4}  PSNR {psnr:5.2}  {gaussians} Gaussians"));
        }
    }

    fn write(
        &self,
        iteration: u32,
        gaussians: &Gaussians,
        network: Option<&[f32]>,
        exposure: Option<&[Exposure]>,
    ) -> Result<PathBuf> {
        // Without planes the file is exactly what other programs write and read.
        let planes = self.config.method == Method::Ibgs;
        let flavor = if planes { PlyFlavor::Full } else { PlyFlavor::Plain };
        let residual = self.trainer.schedule().residual_at(iteration);
        let path = self.folder.point_cloud_path(iteration);
        // The Gaussians last: a folder holds a model once it holds them, and never one without its network or exposures.
        let written = || -> Result<()> {
            if let Some(network) = network.filter(|_| residual) {
                weights::write(&self.folder.network_save_path(iteration), network)?;
            }
            if let Some(photos) = exposure {
                self.folder.write_exposures(iteration, &self.dataset, photos)?;
            }
            Ok(write_ply(&path, gaussians, flavor)?)
        };
        if let Err(error) = written() {
            // Without them the other files are of no use.
            if let Some(folder) = path.parent().filter(|_| !path.is_file()) {
                let _ = fs::remove_dir_all(folder);
            }
            return Err(error);
        }
        Ok(path)
    }

    fn evaluate(&mut self) -> Result<()> {
        let iteration = self.trainer.iteration();
        if self.dataset.test.is_empty() {
            return Ok(());
        }
        let renderer = self.trainer.renderer()?;
        let target = (&self.folder, iteration);
        let scores = score_test_views(&renderer, &self.dataset, &self.config, target, None, |_, _| {})?;
        scores.write(&self.folder, iteration, &protocol(&self.config, &self.dataset, self.raster.gpu()))?;
        let ms = 1e3 * self.records.watch.total().as_secs_f64() / f64::from(iteration.max(1));
        tell!(
            "iteration {iteration}: test {} over {} views; {} Gaussians, {ms:.2} ms an iteration so far",
            scores.sentence(),
            scores.base.len(),
            self.trainer.splats().len()
        );
        if let Some(sentence) = scores.regions_sentence() {
            tell!("   {sentence}");
        }
        let mean = |scores: &[ViewScore]| -> Option<Score> { (!scores.is_empty()).then(|| means(scores)) };
        self.records.evaluations.extend(mean(&scores.base).map(|base| Evaluation {
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
            "seconds": self.records.watch.total().as_secs_f64(),
            "iterations": self.trainer.iteration(),
            "stages": self.records.watch.json(),
            "device": self.raster.gpu().describe(),
        });
        Ok(self.folder.write_result(self.trainer.iteration(), TIME_FILE, time)?)
    }
}

impl Training for Run {
    fn step(&mut self, told: &dyn Fn(&str)) -> Result<()> {
        if self.trainer.iteration() >= self.config.iterations {
            return Ok(());
        }
        let stepped = self.advance().and_then(|due| {
            if due.evaluate {
                told("measuring on the held-out views");
            } else if due.save {
                told("saving");
            }
            self.follow(due)
        });
        stepped.or_else(|error| self.go_back(error)).map_err(|error| self.rescue(error))
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
            seconds: self.records.watch.total().as_secs_f64(),
            evaluations: self.records.evaluations.clone(),
        }
    }

    fn renderer(&self) -> Result<Renderer> {
        Ok(self.trainer.renderer()?.showing_surface())
    }

    fn save(&mut self) -> Result<PathBuf> {
        let renderer = self.trainer.renderer()?;
        let network = renderer.part().map(|part| part.network.to_values()).transpose()?;
        let exposure = renderer.exposure().map(ExposureField::photos);
        let gaussians = self.trainer.splats().download()?;
        // What is read from a lost device looks like any other answer.
        self.raster.gpu().check()?;
        self.write(self.trainer.iteration(), &gaussians, network.as_deref(), exposure)
    }

    fn finish(&mut self) -> Result<()> {
        let iteration = self.trainer.iteration();
        if iteration == 0 {
            return Ok(());
        }
        let is_whole = iteration == self.config.iterations;
        // First of all: what follows takes its time.
        let kept = if is_whole { Ok(()) } else { self.keep(true).and_then(|()| self.keeper.finish()) };
        // One that was stopped in between, or before it was saved.
        let save = !self.folder.point_cloud_path(iteration).is_file();
        let evaluate = self.records.evaluations.last().is_none_or(|last| last.iteration != iteration);
        let settled = self.settle(save, evaluate);
        match &kept {
            Ok(()) if !is_whole => {
                settled.context("`--resume` goes on from here, but not all was saved and measured")?
            }
            _ => settled?,
        }
        if self.trainer.overflowed() {
            tell!("note: some iterations had more tile intersections than there was room for, and were left out");
        }
        self.write_time()?;
        tell!(
            "trained {iteration} iterations in {:.1} s (start-up, evaluation and saving {:.1} s more); {} Gaussians",
            self.records.watch.total().as_secs_f64(),
            (self.started.elapsed() + self.before).saturating_sub(self.records.watch.total()).as_secs_f64(),
            self.trainer.splats().len()
        );
        tell!("stages: {}", self.records.watch.sentence());
        match (self.config.exposure.enabled, self.trainer.exposure()?) {
            (ExposureSwitch::Off, _) => {}
            (_, Some(field)) => {
                let [gains, offsets] = field.trust().map(|part| 100.0 * part);
                tell!(
                    "exposure: the photos differ by {:.1} % (root mean square of their gains); {gains:.0} % of that can be predicted \
                     from the photos around, {offsets:.0} % of their offsets",
                    100.0 * field.spread()
                );
            }
            (_, None) => tell!("exposure: the photos hardly differ; not corrected"),
        }
        if is_whole {
            return self.keeper.clear();
        }
        kept?;
        tell!("`ibgs train --resume -m {}` goes on from here", self.folder.root().display());
        Ok(())
    }
}

fn progress_bar(iterations: u32) -> ProgressBar {
    let bar = ProgressBar::new(u64::from(iterations));
    let style = "{bar:28} {pos}/{len}  {msg}  {per_sec} {eta} left";
    bar.set_style(ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}
