//! One training run: the model, its optimiser, the photos on the device. The loop body is in `iteration`.

mod error;
mod iteration;
mod resume;
mod start;
mod total;

pub use error::TrainError;

use super::background::iteration_background;
use super::densify::free_space::FreeSpace;
use super::densify::{self, Round, Statistics, Strategy};
use super::exposing::Exposing;
use super::optim::Optimizer;
use super::refining::Refining;
use super::stages::ImageStages;
use super::telemetry::{Recorder, Telemetry};
use super::transients::{MaskRules, Masking, Oddity};
use crate::loss::{ImageLoss, Loss};
use crate::parameters::Parameters;
use crate::tensor;
use ibgs_core::camera::Camera;
use ibgs_core::config::TrainConfig;
use ibgs_core::config::schedule::Schedule;
use ibgs_core::dataset::{CellMask, Dataset};
use ibgs_core::exposure::{Exposure, ExposureField, ExposureState};
use ibgs_core::gpu::{Gpu, GpuError, Mark};
use ibgs_core::raster::{Dropout, RasterView, Rasterizer};
use ibgs_core::render::Renderer;
use ibgs_core::scene::Splats;
use ibgs_core::sources::source_store::SourceStore;
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
    /// Those beside it.
    losses: Vec<Box<dyn Loss>>,
    config: TrainConfig,
    schedule: Schedule,
    parameters: Parameters,
    optimizer: Optimizer,
    statistics: Statistics,
    /// The photos' exposures, where they are corrected.
    exposing: Option<Exposing>,
    /// The photos' cameras, where they learn.
    refining: Option<Refining>,
    /// The photos' masks, where they are learned.
    masking: Option<Masking>,
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
    strategy: Box<dyn Strategy>,
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
    /// The further members of an ensemble.
    members: Vec<Trainer>,
}

impl Trainer {
    /// Begins with a trained residual network, flat weights `[WEIGHTS]`; without one of its own it ignores it.
    ///
    /// # Errors
    /// Another number of weights, not enough memory.
    pub fn set_network(&mut self, weights: &[f32]) -> Result<(), TrainError> {
        self.stages.as_mut().map_or(Ok(()), |stages| stages.set_network(weights))?;
        self.members.iter_mut().try_for_each(|member| member.set_network(weights))
    }

    /// Begins with these exposures of the training photos, in their order; where they are not corrected it ignores them.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn set_exposures(&mut self, photos: &[Exposure]) -> Result<(), TrainError> {
        let states: Vec<_> =
            photos.iter().map(|&exposure| ExposureState { exposure, ..ExposureState::default() }).collect();
        Ok(self.exposing.as_mut().map_or(Ok(()), |exposing| exposing.restore(&states))?)
    }

    /// Adds a loss to those of the options. A checkpoint does not hold it.
    pub fn add_loss(&mut self, loss: Box<dyn Loss>) {
        self.losses.push(loss);
    }

    /// Densifies by this strategy in place of the one that the options name, whose milestones stay; for the data set that the
    /// training began with. A checkpoint does not hold it.
    pub fn set_strategy(&mut self, strategy: Box<dyn Strategy>, dataset: &Dataset) {
        let part = strategy.free_space(&self.config.densify);
        self.free_space = FreeSpace::new(&self.cameras, (&dataset.points, &dataset.space()), part);
        self.strategy = strategy;
    }

    /// Lets the number of Gaussians of each member grow to `most` at most.
    pub fn limit_splats(&mut self, most: u32) {
        self.config.densify.max_splats = Some(most);
        self.members.iter_mut().for_each(|member| member.limit_splats(most));
    }

    /// The further members of an ensemble.
    pub fn members(&self) -> &[Self] {
        &self.members
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
        let members = self.members.iter().map(Self::renderer).collect::<Result<_, _>>()?;
        Ok(renderer.with_exposure(self.exposure()?).with_members(members, self.config.weighted_as_the_first()))
    }

    /// The photos' exposures as they are now; none where they are not corrected. Waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn exposure(&self) -> Result<Option<ExposureField>, GpuError> {
        self.exposing.as_ref().map(|exposing| exposing.field(&self.scene_cameras)).transpose()
    }

    /// The cameras of the training views in the scene's coordinates, as the training has them now.
    pub fn scene_cameras(&self) -> &Arc<[Camera]> {
        &self.scene_cameras
    }

    /// The angle, in radians, and the distance, as a part of the distance to what a view shows, by which the camera of each training
    /// view was moved; none where they are not refined.
    pub fn moved_cameras(&self) -> Option<Vec<[f64; 2]>> {
        self.refining.as_ref().map(Refining::moved)
    }

    /// The learned masks of the training photos, in their order; none where none are learned.
    pub fn masks(&self) -> Option<Vec<Arc<CellMask>>> {
        self.masking.as_ref().map(Masking::masks)
    }

    /// Decides over the masks by other numbers from here on, to measure with. A checkpoint does not keep them.
    pub fn set_mask_rules(&mut self, rules: MaskRules) {
        if let Some(masking) = &mut self.masking {
            masking.rules = rules;
        }
    }

    /// How each training photo disagrees with the others as a whole, in their order; none where no masks are learned.
    pub fn oddities(&self) -> Option<Vec<Option<Oddity>>> {
        self.masking.as_ref().map(Masking::oddities)
    }

    /// Takes the steps of the cameras that are due.
    fn refine(&mut self) -> Result<(), GpuError> {
        let rate = self.caution * self.schedule.poses_lr(self.iteration);
        let Some(refining) = &mut self.refining else { return Ok(()) };
        if refining.step(rate)? {
            let [scene, local] = refining.cameras();
            self.set_cameras(&scene, &local);
        }
        Ok(())
    }

    /// Sees the training views from these cameras from here on, and so do its members.
    fn set_cameras(&mut self, scene: &Arc<[Camera]>, local: &Arc<[Camera]>) {
        (self.scene_cameras, self.cameras) = (scene.clone(), local.clone());
        self.stages.iter_mut().for_each(|stages| stages.set_cameras(local));
        self.members.iter_mut().for_each(|member| member.set_cameras(scene, local));
    }

    /// Colour behind the Gaussians.
    pub fn background(&self) -> [f32; 3] {
        self.config.background()
    }

    /// Colour behind the Gaussians in this iteration's loss.
    fn iteration_background(&self) -> [f32; 3] {
        iteration_background(&self.config, self.iteration)
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
        self.overflowed || self.members.iter().any(Self::overflowed)
    }

    /// One iteration.
    ///
    /// # Errors
    /// Not enough memory, device lost, or a loss that is not finite.
    pub fn step(&mut self) -> Result<(), TrainError> {
        self.is_whole = false;
        for member in &mut self.members {
            if member.iteration < member.config.iterations() {
                member.step()?;
            }
        }
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
        if self.schedule.masks_at(self.iteration, self.cameras.len())
            && let Some(masking) = &mut self.masking
        {
            masking.make_masks(&self.photos)?;
        }
        Ok(())
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
        let plan = self.strategy.plan(&observations, &self.config.densify, &round, &mut self.rng);
        (self.parameters, self.optimizer) = densify::apply(&self.gpu, &self.parameters, &self.optimizer, plan)?;
        self.statistics = Statistics::new(&self.gpu, self.splats().len())?;
        // The old model's memory is free before the next iteration needs more of it.
        self.gpu.wait()?;
        // Room for as many additional intersections as there are Gaussians now.
        let grown = self.telemetry.most_isects as f64 * self.splats().len() as f64 / before.max(1) as f64;
        self.raster.reserve(grown as u64);
        Ok(())
    }
}
