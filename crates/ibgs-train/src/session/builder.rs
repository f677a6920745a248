//! How a session begins: its options are checked, its scene is loaded, a stopped training is resumed, the Gaussians are limited
//! to the memory that there is, and its folder is locked and written.

mod error;
mod start;

pub use error::BuildError;
use start::Start;

use super::adjusting::adjust_cameras;
use super::forecast::Device;
use super::{
    CheckpointWriter, Event, Forecast, Observer, Output, Preparation, Records, Session, StoppedTraining, network_size,
};
use crate::densify::Strategy;
use crate::loss::Loss;
use crate::memory::Needs;
use crate::{Trainer, exposure_trial, find_points};
use ibgs_core::camera::Camera;
use ibgs_core::config::{ExposureSwitch, Method, PoseSwitch, TrainConfig};
use ibgs_core::dataset::{Dataset, shown_by_any};
use ibgs_core::gpu::Gpu;
use ibgs_core::model::load_scene;
use ibgs_core::output::{FolderLock, OutputFolder};
use ibgs_core::raster::Rasterizer;
use ibgs_core::residual::weights;
use ibgs_core::sources::memory::MemoryBudget;
use rayon::prelude::*;
use serde::Deserialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

type Result<T> = std::result::Result<T, BuildError>;

/// Seconds of a training on a software adapter that are worth a word before it begins.
const LONG: f64 = 600.0;

/// Describes a session; [`SessionBuilder::build`] prepares it.
#[derive(Debug)]
pub struct SessionBuilder {
    config: TrainConfig,
    dataset: Option<Dataset>,
    stopped: Option<StoppedTraining>,
    output: Option<Output>,
    gpu_memory: MemoryBudget,
    checkpoint_every: Option<Duration>,
    command: Option<String>,
    losses: Vec<Box<dyn Loss>>,
    strategy: Option<Box<dyn Strategy>>,
}

impl SessionBuilder {
    /// A training with these options that writes nothing.
    pub(super) fn new(config: TrainConfig) -> Self {
        Self {
            config,
            dataset: None,
            stopped: None,
            output: None,
            gpu_memory: MemoryBudget::Auto,
            checkpoint_every: Some(Duration::from_secs(120)),
            command: None,
            losses: Vec::new(),
            strategy: None,
        }
    }

    /// Trains on this scene, in place of the folder that the options name.
    pub fn dataset(self, dataset: Dataset) -> Self {
        Self { dataset: Some(dataset), ..self }
    }

    /// Writes files.
    pub fn output(self, output: Output) -> Self {
        Self { output: Some(output), ..self }
    }

    /// Resumes a stopped training in its own folder. The builder's options must be those of its checkpoint, but for the places
    /// of the scene and its split, which may have moved, and the host's memory.
    pub fn resumed_from(self, stopped: StoppedTraining) -> Self {
        Self { stopped: Some(stopped), ..self }
    }

    /// Device memory that the training may use; the number of Gaussians stops growing there. By default nine tenths of what
    /// other programs leave.
    pub fn gpu_memory(self, gpu_memory: MemoryBudget) -> Self {
        Self { gpu_memory, ..self }
    }

    /// Time between two checkpoints, by default two minutes; none: only when the training stops.
    pub fn checkpoint_every(self, checkpoint_every: Option<Duration>) -> Self {
        Self { checkpoint_every, ..self }
    }

    /// The command line that starts or resumes the training, for its figures.
    pub fn command(self, command: String) -> Self {
        Self { command: Some(command), ..self }
    }

    /// Adds a loss to those of the options. A checkpoint does not hold it: give it again to resume.
    pub fn loss(mut self, loss: Box<dyn Loss>) -> Self {
        self.losses.push(loss);
        self
    }

    /// Densifies by this strategy in place of the one that the options name, whose milestones stay. A checkpoint does not hold it:
    /// give it again to resume.
    pub fn strategy(self, strategy: Box<dyn Strategy>) -> Self {
        Self { strategy: Some(strategy), ..self }
    }

    /// The options.
    pub fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// Prepares the session, and reports what is being done.
    ///
    /// # Errors
    /// Those of [`SessionBuilder::load`] and [`Loaded::build`].
    pub fn build(self, gpu: &Arc<Gpu>, observer: &mut dyn Observer) -> Result<Session> {
        self.load(observer)?.build(gpu, observer)
    }

    /// Everything that needs no GPU: checks the options and the folder, reads the files that the training begins with, and loads
    /// the scene. Writes nothing.
    ///
    /// # Errors
    /// An option makes no sense, or differs from that of the training that is resumed. The folder is taken. A file is missing or
    /// damaged.
    pub fn load(mut self, observer: &mut dyn Observer) -> Result<Loaded> {
        // Errors that need no GPU come first; nothing is written before everything is checked.
        if let Some(stopped) = &mut self.stopped {
            self.config = stopped.adopt(&self.config)?;
        }
        self.config.validate()?;
        let is_new = self.stopped.is_none();
        if let Some(output) = self.output.as_ref().filter(|_| is_new) {
            output.check(self.config.source.as_deref())?;
        }
        let start = self.config.init.as_deref().filter(|_| is_new).map(Start::read).transpose()?;
        let network = self.config.residual.init.as_deref().filter(|_| is_new);
        let network = network.map(weights::load).transpose()?;
        if let (None, Some(source)) = (&self.dataset, &self.config.source) {
            observer.event(&Event::Loading);
            self.dataset = Some(load_scene(&self.config, source, observer.progress())?);
        }
        Ok(Loaded { builder: self, start, network })
    }
}

/// A session whose files are read, and which has not touched the GPU yet.
#[derive(Debug)]
pub struct Loaded {
    builder: SessionBuilder,
    /// What it begins with in place of the scene's points.
    start: Option<Start>,
    network: Option<Vec<f32>>,
}

impl Loaded {
    /// The options.
    pub fn config(&self) -> &TrainConfig {
        &self.builder.config
    }

    /// Whether there is a scene; where the options name none, [`Loaded::set_dataset`] gives it.
    pub fn has_scene(&self) -> bool {
        self.builder.dataset.is_some()
    }

    /// Gives options the values that they have for a scene or a GPU; a resumed training keeps its own.
    pub fn adapt(&mut self, change: impl FnOnce(&mut TrainConfig)) {
        if self.builder.stopped.is_none() {
            change(&mut self.builder.config);
        }
    }

    /// Trains on this scene.
    pub fn set_dataset(&mut self, dataset: Dataset) {
        self.builder.dataset = Some(dataset);
    }

    /// Everything else: finds first points in the photos, tries exposures, makes the trainer and limits its memory; then locks
    /// the folder and writes what is known before a training.
    ///
    /// # Errors
    /// There is no scene. Not enough memory, no training view, or the device failed. The checkpoint belongs to another scene. The
    /// folder is taken or cannot be written.
    pub fn build(self, gpu: &Arc<Gpu>, observer: &mut dyn Observer) -> Result<Session> {
        let Self { mut builder, start, network } = self;
        let (mut dataset, mut config) = (builder.dataset.take().ok_or(BuildError::NoScene)?, builder.config.clone());
        if gpu.is_software() {
            config.ensemble.get_or_insert(1);
        }
        config.adapt_to(&dataset);
        // Before anything is written, or removed: what the photos show may forbid an option.
        config.validate()?;
        let known = dataset.notes.len();
        adjust_cameras(&mut dataset, &mut config, observer.progress())?;
        find_points(gpu, &mut dataset, &config, observer.progress())?;
        dataset.notes[known..].iter().for_each(|note| observer.event(&Event::Note(note)));
        observer.event(&Event::Preparing);
        let started = Instant::now();
        let raster = Arc::new(Rasterizer::new(gpu.clone()));
        gpu.warm_up(config.method == Method::Ibgs)?;
        if start.as_ref().is_some_and(Start::has_exposures) && config.exposure.enabled == ExposureSwitch::Auto {
            config.exposure.enabled = ExposureSwitch::On;
        }
        builder.decide(&raster, &dataset, &mut config, observer)?;
        let mut trainer = builder.trainer(&raster, &dataset, &mut config, start.as_ref())?;
        builder.losses.drain(..).for_each(|loss| trainer.add_loss(loss));
        if let Some(strategy) = builder.strategy.take() {
            trainer.set_strategy(strategy, &dataset);
        }
        if let Some(network) = &network {
            trainer.set_network(network)?;
        }
        let mut needs = Needs::of(&trainer, &raster, &dataset, &config);
        if let Some(limit) = needs.limit(builder.gpu_memory, gpu)? {
            observer.event(&Event::Limited(&limit));
            config.densify.max_splats = Some(limit.fits);
            trainer.limit_splats(limit.fits);
        }
        let (folder, lock) = builder.open_folder(&config, &dataset, observer)?.unzip();
        let forecast = Forecast::new(&config, if gpu.is_software() { Device::Processor } else { Device::Gpu });
        builder.warn_of_time(&forecast, gpu, &dataset, observer);
        let init = config.init.clone().filter(|_| start.is_some());
        let prepared = Preparation { init, ..preparation(&dataset, &config, folder.as_ref(), &needs) };
        observer.event(&Event::Prepared(&prepared));
        let every = builder.checkpoint_every.filter(|_| folder.is_some());
        let session = Session {
            forecast,
            checkpoints: CheckpointWriter::new(folder.clone(), every),
            trainer,
            raster,
            loaded_cameras: Session::refined_from(&dataset, config.poses.refine == PoseSwitch::On),
            dataset,
            config,
            folder,
            records: Records::default(),
            started,
            before: Duration::ZERO,
            lost_records: None,
            _lock: lock,
        };
        builder.with_records(session)
    }
}

impl SessionBuilder {
    /// Sets the options that a trial or a clock decides, unless they are given; a resumed training has them.
    fn decide(
        &self,
        raster: &Arc<Rasterizer>,
        dataset: &Dataset,
        config: &mut TrainConfig,
        observer: &mut dyn Observer,
    ) -> Result<()> {
        if self.stopped.is_some() {
            return Ok(());
        }
        if let Some(evidence) = exposure_trial::resolve(raster, dataset, config)? {
            observer.event(&Event::ExposureTried(&evidence));
        }
        if let Some(network) = network_size::choose(raster.gpu(), dataset, config)? {
            observer.event(&Event::SmallNetwork(&network));
        }
        Ok(())
    }

    fn trainer(
        &self,
        raster: &Arc<Rasterizer>,
        dataset: &Dataset,
        config: &mut TrainConfig,
        start: Option<&Start>,
    ) -> Result<Trainer> {
        Ok(match (&self.stopped, start) {
            (Some(stopped), _) => Trainer::resume(raster.clone(), dataset, stopped.checkpoint())?,
            (None, Some(start)) => {
                config.sh_degree = Some(start.gaussians.sh_degree);
                let mut trainer = Trainer::from_gaussians(raster.clone(), dataset, config, &start.gaussians)?;
                if let Some(exposures) = start.exposures(dataset) {
                    trainer.set_exposures(&exposures)?;
                }
                trainer
            }
            (None, None) => Trainer::new(raster.clone(), dataset, config)?,
        })
    }

    /// The folder with what is known before the training, locked; none: nothing is written.
    fn open_folder(
        &self,
        config: &TrainConfig,
        dataset: &Dataset,
        observer: &mut dyn Observer,
    ) -> Result<Option<(OutputFolder, FolderLock)>> {
        let Some(stopped) = &self.stopped else {
            return self.output.as_ref().map(|output| output.create(config, dataset)).transpose();
        };
        let (iteration, iterations) = (stopped.checkpoint().iteration(), config.iterations());
        observer.event(&Event::Resuming { iteration, iterations });
        let folder = stopped.folder().clone();
        let lock = folder.lock()?;
        // The scene may have moved.
        config.save(&folder.config_path())?;
        Ok(Some((folder, lock)))
    }

    /// The session with the records of the training that it resumes, and with its command line.
    fn with_records(self, mut session: Session) -> Result<Session> {
        if let Some(checkpoint) = self.stopped.as_ref().map(StoppedTraining::checkpoint) {
            session.checkpoints.resumed(checkpoint.iteration());
            match Records::deserialize(&checkpoint.run) {
                Ok(records) => (session.before, session.records) = (records.watch.total(), records),
                Err(error) => session.lost_records = Some(error.to_string()),
            }
        }
        session.records.commands.extend(self.command);
        session.adopt_cameras()?;
        Ok(session)
    }

    /// Says so where a software adapter will take long, of a training that begins.
    fn warn_of_time(&self, forecast: &Forecast, gpu: &Gpu, dataset: &Dataset, observer: &mut dyn Observer) {
        if self.stopped.is_some() || !gpu.is_software() {
            return;
        }
        let pixels: usize = dataset.train.iter().map(|&view| dataset.views[view].camera.pixels()).sum();
        let cores = std::thread::available_parallelism().map_or(1, Into::into);
        let seconds = forecast.on_software(pixels as f64 / dataset.train.len().max(1) as f64, cores);
        if seconds >= LONG {
            observer.event(&Event::Slow { adapter: &gpu.info.name, seconds });
        }
    }
}

fn preparation(dataset: &Dataset, config: &TrainConfig, folder: Option<&OutputFolder>, needs: &Needs) -> Preparation {
    let cameras: Vec<Camera> = dataset.train.iter().map(|&view| dataset.views[view].camera).collect();
    Preparation {
        training_views: dataset.train.len(),
        test_views: dataset.test.len(),
        points: dataset.points.len(),
        shown: shown_by_any(&cameras, dataset.points.par_iter().map(|point| point.position)),
        init: None,
        iterations: config.iterations(),
        folder: folder.map(|folder| folder.root().to_owned()),
        at_start: needs.at_start(),
        at_most: needs.grows().then(|| needs.at_most()),
    }
}
