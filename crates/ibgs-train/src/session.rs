//! A training run with everything around it: checkpoints, saving, measuring, return to the last good state.
//!
//! ```no_run
//! use ibgs_core::config::TrainConfig;
//! use ibgs_core::gpu::{AdapterChoice, Gpu, Use};
//! use ibgs_train::Session;
//! use ibgs_train::session::Output;
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut config = TrainConfig { iterations: Some(7_000), ..TrainConfig::default() };
//! config.source = Some("my-scene".into());
//! let gpu = Gpu::open(&AdapterChoice::Best, Use::Training)?;
//! let mut session = Session::builder(config).output(Output::at("my-model")).build(&gpu, &mut ())?;
//! session.run(&mut ())?;
//! # Ok(())
//! # }
//! ```

mod adjusting;
mod builder;
mod cameras;
mod checkpoint_writer;
mod error;
mod event;
mod forecast;
mod json_lines;
mod network_size;
mod output;
mod preparation;
mod saving;
mod stopped;
mod transients;
mod watch;

pub use adjusting::adjust_cameras;
pub use builder::{BuildError, Loaded, SessionBuilder};
pub use cameras::CameraSummary;
pub use error::SessionError;
pub use event::{Event, ExposureSummary, Observer, Summary};
pub use json_lines::JsonLines;
pub use network_size::SmallNetwork;
pub use output::Output;
pub use preparation::Preparation;
pub use stopped::StoppedTraining;
pub use transients::TransientSummary;

use crate::{MaskRules, TrainError, Trainer};
use checkpoint_writer::CheckpointWriter;
use forecast::Forecast;
use ibgs_core::camera::Camera;
use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::Dataset;
use ibgs_core::gpu::Gpu;
use ibgs_core::output::log::{Evaluation, LogEntry, TrainingLog, TrainingProgress};
use ibgs_core::output::{FolderLock, OutputFolder};
use ibgs_core::raster::Rasterizer;
use ibgs_core::render::Renderer;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use watch::Watch;

type Result<T> = std::result::Result<T, SessionError>;

/// Factor on the learning rates after a value was not finite.
const CAUTION: f64 = 0.5;

/// What a run keeps beside its training; checkpoints hold it too.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
struct Records {
    /// Time and memory of the iterations alone.
    watch: Watch,
    log: TrainingLog,
    evaluations: Vec<Evaluation>,
    /// The command lines that it was started and resumed with, where a program said so.
    commands: Vec<String>,
}

/// What is to be done after an iteration.
#[derive(Clone, Copy, Default)]
struct Due {
    save: bool,
    evaluate: bool,
    /// The state is to be taken.
    keep: bool,
    /// And then written.
    write: bool,
    /// Nothing comes after it: what cannot be written then is an error.
    ends: bool,
}

/// A training run.
pub struct Session {
    trainer: Trainer,
    raster: Arc<Rasterizer>,
    dataset: Dataset,
    /// The cameras of all views as they were loaded, where the training refines its own.
    loaded_cameras: Option<Vec<Camera>>,
    config: TrainConfig,
    folder: Option<OutputFolder>,
    records: Records,
    forecast: Forecast,
    checkpoints: CheckpointWriter,
    started: Instant,
    /// Time of the iterations before a resumed run.
    before: Duration,
    /// The records of the checkpoint could not be read.
    lost_records: Option<String>,
    /// Keeps others out of the folder.
    _lock: Option<FolderLock>,
}

impl Session {
    /// Describes a training with these options, step by step. As it is it writes nothing.
    pub fn builder(config: TrainConfig) -> SessionBuilder {
        SessionBuilder::new(config)
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
        self.config.source.as_deref()
    }

    /// Where it writes; none: nowhere.
    pub fn folder(&self) -> Option<&OutputFolder> {
        self.folder.as_ref()
    }

    /// Decides over the masks of what moves by other numbers from here on ([`Trainer::set_mask_rules`]).
    pub fn set_mask_rules(&mut self, rules: MaskRules) {
        self.trainer.set_mask_rules(rules);
    }

    /// Whether all iterations are done.
    pub fn is_done(&self) -> bool {
        self.trainer.iteration() >= self.config.iterations()
    }

    /// Trains to the end, or until the observer ends it; then saves, measures and reports ([`Session::finish`]).
    ///
    /// # Errors
    /// The device failed, a file cannot be written, or a value is not finite, after what can be saved was saved.
    pub fn run(&mut self, observer: &mut dyn Observer) -> Result<()> {
        let mut flow = ControlFlow::Continue(());
        while !self.is_done() && flow.is_continue() {
            self.step(observer)?;
            flow = observer.iteration(&self.progress());
        }
        if flow.is_break() {
            observer.event(&Event::Stopped { iteration: self.trainer.iteration() });
        }
        self.finish(observer)
    }

    /// One iteration, and what is due after it; nothing after the last one.
    ///
    /// # Errors
    /// As [`Session::run`].
    pub fn step(&mut self, observer: &mut dyn Observer) -> Result<()> {
        if self.is_done() {
            return Ok(());
        }
        if let Some(error) = self.lost_records.take() {
            observer.event(&Event::NoRecords { error });
        }
        let stepped = self.advance().and_then(|due| {
            if due.evaluate {
                observer.event(&Event::Measuring);
            } else if due.save {
                observer.event(&Event::Saving);
            }
            self.follow(due, observer)
        });
        stepped.or_else(|error| self.go_back(error, observer)).map_err(|error| self.rescue(error, observer))
    }

    /// One iteration.
    fn advance(&mut self) -> Result<Due> {
        let start = Instant::now();
        // A lost device often accepts work without an error.
        self.raster.gpu().check()?;
        self.trainer.step()?;
        let (iteration, schedule) = (self.trainer.iteration(), self.trainer.schedule());
        self.records.watch.count(schedule, iteration, self.raster.gpu());
        let (save, evaluate) = (schedule.save_at(iteration), schedule.evaluate_at(iteration));
        let (keep, write) = self.checkpoints.due();
        // Keep a state before a new stage: its first iteration needs more memory, and the allocation may fail. After
        // the last iteration nothing remains to be resumed.
        let ends = iteration >= self.config.iterations();
        let keep = (keep || watch::stage_ends(schedule, iteration)) && !ends;
        let due = Due { save, evaluate, keep, write: keep && write, ends };
        // Wait, so that pending work counts as time of the iterations and not of what follows. The last iteration is
        // always saved.
        if save || evaluate || keep {
            self.raster.gpu().wait()?;
        }
        let time = start.elapsed();
        self.records.watch.spent(time);
        self.forecast.count(iteration, time);
        self.note();
        Ok(due)
    }

    /// Does what is due after an iteration, and then keeps the state: a resumed run does nothing of the rest.
    fn follow(&mut self, due: Due, observer: &mut dyn Observer) -> Result<()> {
        if due.save || due.evaluate {
            self.do_due(due, observer)?;
        }
        if due.keep {
            self.keep()?;
        }
        if due.write {
            self.checkpoints.begin(observer);
        }
        Ok(())
    }

    /// Takes the state as it is now.
    fn keep(&mut self) -> Result<()> {
        if self.trainer.iteration() > 0 {
            let start = Instant::now();
            let checkpoint = self.trainer.checkpoint(serde_json::to_value(&self.records)?)?;
            self.checkpoints.take(checkpoint, start.elapsed());
        }
        Ok(())
    }

    /// After a value that was not finite: return to the last good state, once, and continue with lower rates.
    fn go_back(&mut self, error: SessionError, observer: &mut dyn Observer) -> Result<()> {
        let broken = matches!(error, SessionError::Train(TrainError::NotFinite(_)));
        let Some(checkpoint) = self.checkpoints.last().filter(|_| broken && !self.trainer.is_slowed()).cloned() else {
            return Err(error);
        };
        let iteration = checkpoint.iteration();
        observer.event(&Event::RolledBack { error: &error, iteration, rates: CAUTION });
        self.trainer.restore(&checkpoint)?;
        self.trainer.slow_down(CAUTION);
        self.checkpoints.went_back(observer);
        self.records = Records::deserialize(&checkpoint.run)?;
        Ok(())
    }

    /// Adds the figures of the training to its log, which ignores figures that it already has.
    fn note(&mut self) {
        let TrainingProgress { iteration, loss, psnr, gaussians, seconds, .. } = self.progress();
        if let (Some(loss), Some(psnr)) = (loss, psnr) {
            self.records.log.add(LogEntry { iteration, loss, psnr, gaussians, seconds });
        }
    }

    /// How far it is.
    pub fn progress(&self) -> TrainingProgress {
        let (iteration, telemetry) = (self.trainer.iteration(), self.trainer.telemetry());
        // Until something has come back from the GPU both are zero.
        let known = telemetry.stats.loss != 0.0;
        TrainingProgress {
            iteration,
            iterations: self.config.iterations(),
            stage: watch::stage(self.trainer.schedule(), iteration.max(1)),
            seconds_left: self.forecast.left(iteration),
            loss: known.then_some(telemetry.stats.loss),
            l1: known.then_some(telemetry.stats.l1),
            ssim: known.then_some(telemetry.stats.ssim),
            psnr: known.then(|| telemetry.stats.psnr()),
            gaussians: self.trainer.splats().len(),
            seconds: self.records.watch.total().as_secs_f64(),
            evaluations: self.records.evaluations.clone(),
        }
    }

    /// A renderer of the model as it is now, used before the next step; it finds the surface of every frame.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn renderer(&self) -> Result<Renderer> {
        Ok(self.trainer.renderer()?.showing_surface())
    }
}
