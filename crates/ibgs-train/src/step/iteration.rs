//! One iteration of method.md section 7: a training view is rendered, its loss goes backward, and a pass at the end records
//! all steps of the optimisers.

use super::{TrainError, Trainer};
use crate::autodiff::{self, Leaves, SplatGradients};
use crate::densify::Step;
use crate::optim::Rates;
use crate::refining::Refining;
use crate::telemetry::Telemetry;
use burn::tensor::{Gradients, Tensor};
use ibgs_core::dataset::HostPhoto;
use ibgs_core::exposure::Exposures;
use ibgs_core::gpu::{Batch, GpuError, Mark, Pass, flush};
use ibgs_core::raster::{Forward, ScreenStatistics};
use ibgs_core::sources::{DevicePhoto, Outside};
use rand::seq::SliceRandom;

/// The training view of an iteration, rendered.
pub(super) struct Rendered {
    /// The image in the photo's exposure.
    pub shown: Tensor<3>,
    pub forward: Forward,
    pub image: Tensor<3>,
    leaves: Leaves,
    /// Exposures of photo and sources, where they are corrected.
    pub exposures: Option<Exposures>,
    /// The view's sources.
    pub sources: Vec<usize>,
    /// Its photo.
    pub target: DevicePhoto,
    /// Training view.
    pub index: usize,
}

impl Trainer {
    /// One iteration, and its end on the device.
    pub(super) fn iterate(&mut self) -> Result<Mark, TrainError> {
        self.restructure()?;
        self.refine()?;
        let batches = !self.losses.iter().any(|loss| loss.uses_burn());
        let _batch = batches.then(|| Batch::new(&self.gpu));
        self.iteration += 1;
        let index = self.next_view();
        let rendered = self.rendered(index)?;
        let total = self.total(&rendered)?;
        flush();
        let loss = match self.masking.as_ref().and_then(|masking| masking.weight(index)) {
            Some(weight) => total.loss() * weight,
            None => total.loss(),
        };
        let mut all = loss.backward();
        let gradients = self.splat_gradients(&rendered.leaves, &mut all);
        let gpu = self.gpu.clone();
        let mut pass = Pass::new(&gpu, "end of iteration");
        if let (Some(exposing), Some(exposures)) = (&mut self.exposing, &rendered.exposures) {
            exposing.record_step(&mut pass, index, exposures, self.schedule.exposure_lr(self.iteration));
        }
        self.record_splat_step(&mut pass, gradients, &rendered.forward);
        if let Some(stages) = &mut self.stages {
            if let Some(network) = &total.network {
                stages.record_step(&mut pass, network, &mut all, self.schedule.network_lr(self.iteration));
            }
            stages.keep_depth(&mut pass, index, &rendered.forward)?;
        }
        if let Some(masking) = self.masking.as_ref().filter(|_| self.schedule.transients_at(self.iteration)) {
            masking.record(&mut pass, index, &rendered.target, &rendered.shown, total.warped.as_ref());
        }
        self.record_check(&mut pass);
        let learns = self.schedule.poses_at(self.iteration);
        let mut refining = self.refining.as_mut().filter(|_| learns);
        let staging = refining.as_mut().map(|refining| refining.record_copy(&mut pass));
        let (stats, forward) = (&total.scratch.stats, &rendered.forward);
        let capacity = u64::from(forward.frame.capacity);
        let (end, telemetry) = self.recorder.submit(&gpu, pass, stats, &forward.workspace.total, capacity)?;
        if let Some((refining, staging)) = refining.zip(staging) {
            refining.sent(index, &rendered.sources, staging, end.clone());
        }
        if let Some(telemetry) = telemetry {
            self.note(telemetry)?;
        }
        self.prefetch()?;
        Ok(end)
    }

    fn next_view(&mut self) -> usize {
        if self.queue.is_empty() {
            self.queue = (0..self.cameras.len()).collect();
            self.queue.shuffle(&mut self.rng);
        }
        self.queue.pop().expect("there are training views")
    }

    /// Renders a training view as this iteration's loss compares it.
    fn rendered(&self, index: usize) -> Result<Rendered, GpuError> {
        let iteration = self.iteration;
        if !self.has_planes && self.schedule.shapes_normals_at(iteration, self.cameras.len()) {
            self.raster.shape_normals(self.splats());
        }
        let target = self.target(index)?;
        let exposing = self.exposing.as_ref().filter(|_| self.schedule.exposure_at(iteration));
        let sources = self.sources(index, iteration);
        let exposures = exposing.map(|exposing| exposing.of(index, &sources)).transpose()?;
        let leaves = Leaves::new(&self.parameters);
        let refining = self.refining.as_ref().filter(|_| self.schedule.poses_at(iteration));
        let cameras = refining.map(Refining::cleared);
        let statistics = self.statistics_at(iteration);
        let (image, forward) = autodiff::rasterized(&self.raster, &leaves, &self.view(index), cameras, statistics)?;
        let shown = match &exposures {
            Some(exposures) => autodiff::exposed(exposures, &image, &forward)?,
            None => image.clone(),
        };
        Ok(Rendered { shown, forward, image, leaves, exposures, sources, target, index })
    }

    /// The photo of a training view as this iteration's loss compares with it.
    fn target(&self, index: usize) -> Result<DevicePhoto, GpuError> {
        let mut target = self.photos.photo(index)?;
        if self.config.data.shows_object() {
            target.outside = Outside::Background(self.iteration_background());
        }
        Ok(target)
    }

    /// Sources of a training view in an iteration; none where they do not count yet.
    fn sources(&self, index: usize, iteration: u32) -> Vec<usize> {
        let stages = self.stages.as_ref().filter(|_| self.schedule.surface_loss_at(iteration));
        stages.map_or_else(Vec::new, |stages| stages.sources_of(index, iteration))
    }

    /// The gradients of the Gaussians, with those of the strategy's own penalties.
    fn splat_gradients(&self, leaves: &Leaves, all: &mut Gradients) -> SplatGradients {
        let mut gradients = leaves.gradients(all).expect("the loss depends on the image");
        self.strategy.penalise(&mut gradients, &self.parameters, &self.config.densify);
        gradients
    }

    /// Where the strategy learns from the view of an iteration; none where it does not.
    fn statistics_at(&self, iteration: u32) -> Option<ScreenStatistics> {
        let reduction = self.strategy.reduction(&self.config.densify, self.extent);
        reduction.filter(|_| self.schedule.grows_at(iteration)).map(|reduction| self.statistics.of_views(reduction))
    }

    /// Records the step of the Gaussians, and what the strategy does after it.
    fn record_splat_step(&mut self, pass: &mut Pass, gradients: SplatGradients, forward: &Forward) {
        let mean_rate = self.schedule.mean_lr(self.iteration, self.extent);
        let rates = Rates::new(&self.config, mean_rate, self.schedule.rate_factor);
        self.optimizer.record_step(pass, gradients, &rates, &forward.frame);
        let step = Step { mean_rate, seed: self.config.seed, iteration: self.iteration };
        self.strategy.record_after_step(pass, self.splats(), &self.config.densify, &step);
    }

    /// Records the count of values that are not finite, in the iterations that count them.
    fn record_check(&self, pass: &mut Pass) {
        if !self.recorder.checks() {
            return;
        }
        pass.relabel("finite numbers");
        self.optimizer.record_check(pass, self.recorder.broken());
        if let Some(stages) = &self.stages {
            stages.record_check(pass, self.recorder.broken());
        }
    }

    fn note(&mut self, telemetry: Telemetry) -> Result<(), TrainError> {
        self.overflowed |= telemetry.overflows > 0;
        self.raster.reserve(telemetry.most_isects);
        self.telemetry = telemetry;
        if telemetry.broken { Err(TrainError::NotFinite(self.iteration)) } else { Ok(()) }
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
}
