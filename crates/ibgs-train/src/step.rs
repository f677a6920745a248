//! One training run: the model, its optimiser, the photos on the device, and the loop body of method.md section 7.

mod error;
mod resume;
mod start;

pub use error::TrainError;

use super::background::iteration_background;
use super::densify::free_space::FreeSpace;
use super::densify::{self, Over, Round, Statistics, mcmc};
use super::exposing::Exposing;
use super::filter::FilterSizes;
use super::optim::{Optimizer, Rates};
use super::stages::{ImageStages, Total, Work};
use super::telemetry::{Recorder, Telemetry};
use crate::autodiff::{self, Leaves};
use crate::loss::ImageLoss;
use crate::parameters::Parameters;
use crate::tensor;
use ibgs_core::camera::Camera;
use ibgs_core::config::schedule::Schedule;
use ibgs_core::config::{Strategy, TrainConfig};
use ibgs_core::dataset::HostPhoto;
use ibgs_core::exposure::ExposureField;
use ibgs_core::gpu::{Batch, Gpu, GpuError, Mark, Pass, flush};
use ibgs_core::raster::{Dropout, RasterView, Rasterizer};
use ibgs_core::render::Renderer;
use ibgs_core::scene::Splats;
use ibgs_core::sources::source_store::SourceStore;
use ibgs_core::sources::{DevicePhoto, Outside};
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use std::collections::VecDeque;
use std::sync::Arc;

/// Iterations on the device while the next is recorded: they keep it busy. The commands of more would need new memory of the
/// driver, which costs the host more than recording them.
const IN_FLIGHT: usize = 2;

/// A running training.
pub struct Trainer {
    gpu: Arc<Gpu>,
    raster: Arc<Rasterizer>,
    loss: ImageLoss,
    config: TrainConfig,
    schedule: Schedule,
    parameters: Parameters,
    optimizer: Optimizer,
    statistics: Statistics,
    /// The 3D smoothing filter, where there is one.
    filters: Option<FilterSizes>,
    /// The photos' exposures, where they are corrected.
    exposing: Option<Exposing>,
    recorder: Recorder,
    telemetry: Telemetry,
    /// Cameras of the training views, in local coordinates.
    cameras: Arc<[Camera]>,
    /// The same in the scene's.
    scene_cameras: Arc<[Camera]>,
    /// Their photos.
    photos: Arc<SourceStore>,
    /// What goes beyond plain splatting.
    stages: Option<ImageStages>,
    /// The first Gaussians came with planes of their own.
    has_planes: bool,
    /// Views still to come in this epoch.
    queue: Vec<usize>,
    extent: f64,
    /// What the pruning by scale measures by.
    prune_length: f64,
    free_space: FreeSpace,
    rng: ChaCha8Rng,
    iteration: u32,
    overflowed: bool,
    /// Checksum of the scene.
    scene: u32,
    /// Part of the learning rates that counts.
    caution: f64,
    /// The last iteration was done to its end.
    is_whole: bool,
    /// Ends of the last ones on the device.
    in_flight: VecDeque<Mark>,
}

impl Trainer {
    /// Begins with a trained residual network, flat weights `[WEIGHTS]`; without one of its own it ignores it.
    ///
    /// # Errors
    /// Another number of weights, not enough memory.
    pub fn set_network(&mut self, weights: &[f32]) -> Result<(), TrainError> {
        self.stages.as_mut().map_or(Ok(()), |stages| stages.set_network(weights))
    }

    /// Lets the number of Gaussians grow to `most` at most.
    pub fn limit_splats(&mut self, most: u32) {
        self.config.densify.max_splats = Some(most);
    }

    fn view(&self, index: usize) -> RasterView {
        let mut view = RasterView::new(self.cameras[index], self.schedule.sh_degree(self.iteration));
        view.background = self.iteration_background();
        if self.schedule.keeps_depth_at(self.iteration, self.cameras.len()) {
            view.surface = self.stages.as_ref().map(|stages| stages.options().surface);
        }
        let residual = &self.config.residual;
        let drops = self.schedule.progress(self.iteration) < self.config.dropout_until();
        if drops && self.schedule.residual_at(self.iteration) {
            view.dropout = Dropout::new(residual.dropout, self.config.seed, self.iteration);
        }
        view
    }

    /// A renderer of the model as it is now; it shares the model's memory, so use it before the next step. Where exposures are
    /// corrected it waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn renderer(&self) -> Result<Renderer, GpuError> {
        let residual = self.stages.as_ref().filter(|_| self.schedule.residual_at(self.iteration));
        let part = residual.map(|stages| stages.part(self.scene_cameras.clone(), self.photos.clone()));
        let renderer = Renderer::new(self.raster.clone(), self.splats().clone(), self.background(), part);
        Ok(renderer.with_exposure(self.exposure()?))
    }

    /// The photos' exposures as they are now; none where they are not corrected. Waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn exposure(&self) -> Result<Option<ExposureField>, GpuError> {
        self.exposing.as_ref().map(|exposing| exposing.field(&self.scene_cameras)).transpose()
    }

    /// Colour behind the Gaussians.
    pub fn background(&self) -> [f32; 3] {
        self.config.background()
    }

    /// Colour behind the Gaussians in this iteration's loss.
    fn iteration_background(&self) -> [f32; 3] {
        iteration_background(&self.config, self.iteration)
    }

    /// The photo of a training view as this iteration's loss compares with it.
    fn target(&self, index: usize) -> Result<DevicePhoto, GpuError> {
        let mut target = self.photos.photo(index)?;
        if self.config.shows_object() {
            target.outside = Outside::Background(self.iteration_background());
        }
        Ok(target)
    }

    /// Iterations done.
    pub fn iteration(&self) -> u32 {
        self.iteration
    }

    /// The model as it is now, in local coordinates.
    pub fn splats(&self) -> &Splats {
        self.parameters.splats()
    }

    /// The run's milestones.
    pub fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    /// Scene extent in local units.
    pub fn extent(&self) -> f64 {
        self.extent
    }

    /// Mean loss of recent iterations; some iterations old.
    pub fn telemetry(&self) -> &Telemetry {
        &self.telemetry
    }

    /// True if an iteration had more intersections than room: its gradient was left out. Known some iterations late.
    pub fn overflowed(&self) -> bool {
        self.overflowed
    }

    /// Sources of a training view in an iteration; none where they do not count yet.
    fn sources(&self, index: usize, iteration: u32) -> Vec<usize> {
        let stages = self.stages.as_ref().filter(|_| self.schedule.surface_loss_at(iteration));
        stages.map_or_else(Vec::new, |stages| stages.sources_of(index, iteration))
    }

    fn next_view(&mut self) -> usize {
        if self.queue.is_empty() {
            self.queue = (0..self.cameras.len()).collect();
            self.queue.shuffle(&mut self.rng);
        }
        self.queue.pop().expect("there are training views")
    }

    /// One iteration.
    ///
    /// # Errors
    /// Not enough memory, device lost, or a loss that is not finite.
    pub fn step(&mut self) -> Result<(), TrainError> {
        self.is_whole = false;
        let gpu = self.gpu.clone();
        let end = tensor::at_memory(&gpu, || self.iterate())??;
        self.is_whole = true;
        self.in_flight.push_back(end);
        if self.in_flight.len() > IN_FLIGHT
            && let Some(first) = self.in_flight.pop_front()
        {
            self.gpu.wait_for(first)?;
        }
        Ok(())
    }

    /// One iteration, and its end on the device.
    fn iterate(&mut self) -> Result<Mark, TrainError> {
        self.restructure()?;
        let _batch = Batch::new(&self.gpu);
        self.iteration += 1;
        let iteration = self.iteration;
        let index = self.next_view();
        if !self.has_planes && self.schedule.shapes_normals_at(iteration, self.cameras.len()) {
            self.raster.shape_normals(self.splats());
        }
        let target = self.target(index)?;
        let exposing = self.exposing.as_ref().filter(|_| self.schedule.exposure_at(iteration));
        let sources = self.sources(index, iteration);
        let exposures = exposing.map(|exposing| exposing.of(index, &sources)).transpose()?;
        let leaves = Leaves::new(&self.gpu, &self.parameters)?;
        let (image, forward) = autodiff::rasterized(&self.raster, &leaves, &self.view(index))?;
        let shown = match &exposures {
            Some(exposures) => autodiff::exposed(exposures, &image, &forward)?,
            None => image.clone(),
        };
        let work = Work {
            iteration,
            index,
            target: &target,
            image: &image,
            shown: &shown,
            exposures: exposures.as_ref(),
            sources: &sources,
            forward: &forward,
            loss: &self.loss,
            schedule: &self.schedule,
            photos: &self.photos,
            raster: &self.raster,
            splats: self.parameters.splats(),
        };
        let total = match &mut self.stages {
            Some(stages) => stages.total(&work)?,
            None => self.loss.tracked(shown.clone(), &target).map(|(loss, scratch)| Total::base(loss, scratch))?,
        };
        flush();
        let mut all = total.loss().backward();
        let mut gradients = leaves.gradients(&mut all).expect("the loss depends on the image");
        let is_mcmc = self.config.densify.strategy == Strategy::Mcmc;
        if is_mcmc {
            flush();
            mcmc::penalise(&mut gradients, &self.parameters, &self.config.densify.mcmc);
        }
        let gpu = self.gpu.clone();
        let mut pass = Pass::new(&gpu, "end of iteration");
        if let (Some(exposing), Some(exposures)) = (&mut self.exposing, &exposures) {
            exposing.record_step(&mut pass, index, exposures, self.schedule.exposure_lr(iteration));
        }
        if self.schedule.observes(iteration) {
            let screen = gradients.screen.clone();
            let how = match self.config.densify.strategy {
                Strategy::Default => (Over::Largest, 0.0),
                _ => (Over::Sum, self.config.densify.near_depth * self.extent),
            };
            let errors = if self.schedule.counts_errors(iteration, &self.config.densify) {
                let (stats, count) = (&total.scratch.stats, self.splats().len());
                Some(densify::covered_errors(&gpu, &mut pass, &forward, (&shown, &target), stats, count)?)
            } else {
                None
            };
            self.statistics.record(&mut pass, screen, &forward, how, errors.as_ref());
        }
        let mean_rate = self.schedule.mean_lr(iteration, self.extent);
        let rates = Rates::new(&self.config, mean_rate, self.schedule.rate_factor);
        self.optimizer.record_step(&mut pass, gradients, &rates);
        if is_mcmc {
            let strength = self.config.densify.mcmc.noise * mean_rate;
            mcmc::record_noise(&mut pass, self.splats(), strength, self.config.seed, iteration);
        }
        if let Some(stages) = &mut self.stages {
            stages.finish(&mut pass, &work, &total, &mut all)?;
        }
        if self.recorder.checks() {
            pass.relabel("finite numbers");
            self.optimizer.record_check(&mut pass, self.recorder.broken());
            if let Some(stages) = &self.stages {
                stages.record_check(&mut pass, self.recorder.broken());
            }
        }
        let (end, telemetry) = self.recorder.submit(
            &gpu,
            pass,
            &total.scratch.stats,
            &forward.workspace.total,
            u64::from(forward.frame.capacity),
        )?;
        if let Some(telemetry) = telemetry {
            self.note(telemetry)?;
        }
        self.prefetch()?;
        Ok(end)
    }

    /// Uploads what the next iteration reads while the GPU still works on this one, and begins to decode what later ones read;
    /// nothing to do where all photos fit.
    fn prefetch(&self) -> Result<(), TrainError> {
        if let (Some(_), Some(&next)) = (&self.stages, self.queue.last()) {
            let mut wanted = vec![next];
            wanted.extend(self.sources(next, self.iteration + 1));
            self.photos.prefetch(&wanted)?;
        }
        if self.photos.decodes_again() {
            for (later, &view) in (1..).zip(self.queue.iter().rev().take(HostPhoto::AHEAD)) {
                self.photos.decode_ahead(&[view]);
                self.photos.decode_ahead(&self.sources(view, self.iteration + later));
            }
        }
        Ok(())
    }

    /// Densification and opacity reset of the iteration that has just ended. They come before the next one and not at
    /// its end, so that a model is saved and measured as it was trained, not right after a change (a departure from the
    /// published order).
    fn restructure(&mut self) -> Result<(), TrainError> {
        if self.schedule.densify_at(self.iteration) {
            self.densify()?;
        }
        if self.schedule.reset_opacity_at(self.iteration) {
            self.optimizer.reset_opacity(&self.gpu, self.config.opacity_reset.max_opacity);
        }
        Ok(())
    }

    fn update_filters(&self) {
        if let Some(filters) = &self.filters {
            filters.update(&self.gpu, self.splats());
        }
    }

    fn note(&mut self, telemetry: Telemetry) -> Result<(), TrainError> {
        self.overflowed |= telemetry.overflows > 0;
        self.raster.reserve(telemetry.most_isects);
        self.telemetry = telemetry;
        if telemetry.broken { Err(TrainError::NotFinite(self.iteration)) } else { Ok(()) }
    }

    fn densify(&mut self) -> Result<(), TrainError> {
        let before = self.splats().len();
        let observations = self.statistics.observations(&self.gpu, self.splats())?;
        let round = Round {
            extent: self.extent,
            prune_length: self.prune_length,
            transparent: self.schedule.prune_transparent(self.iteration),
            large: self.schedule.prune_large(self.iteration),
            grows: self.schedule.grows_at(self.iteration),
            progress: self.schedule.progress(self.iteration),
            until_half: self.schedule.rounds_until_half(self.iteration),
            free_space: &self.free_space,
        };
        let plan = densify::plan(&observations, &self.config.densify, &round, &mut self.rng);
        (self.parameters, self.optimizer) = densify::apply(&self.gpu, &self.parameters, &self.optimizer, plan)?;
        self.statistics = Statistics::new(&self.gpu, self.splats().len())?;
        // The old model's memory is free before the next iteration needs more of it.
        self.gpu.wait()?;
        self.update_filters();
        // Room for as many additional intersections as there are Gaussians now.
        let grown = self.telemetry.most_isects as f64 * self.splats().len() as f64 / before.max(1) as f64;
        self.raster.reserve(grown as u64);
        Ok(())
    }
}
