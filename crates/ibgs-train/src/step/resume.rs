//! A training on the host and back: checkpoints.

use super::{TrainError, Trainer};
use crate::checkpoint::{Checkpoint, TrainingState};
use crate::densify::Statistics;
use crate::exposing::Exposing;
use crate::optim::Optimizer;
use crate::parameters::Parameters;
use crate::refining::Refining;
use crate::stages::ImageStages;
use crate::telemetry::Recorder;
use crate::transients::Masking;
use ibgs_core::config::schedule::Schedule;
use ibgs_core::dataset::Dataset;
use ibgs_core::raster::Rasterizer;
use std::sync::Arc;

impl Trainer {
    /// Resumes from a checkpoint, with its options. With `deterministic` the rest of the run is bit for bit what it
    /// would have been on the same adapter.
    ///
    /// # Errors
    /// [`TrainError::Checkpoint`] when it does not belong to the scene or contradicts itself, not enough memory.
    pub fn resume(raster: Arc<Rasterizer>, dataset: &Dataset, checkpoint: &Checkpoint) -> Result<Self, TrainError> {
        let sizes: Vec<[u32; 2]> = dataset.train.iter().map(|&i| dataset.views[i].photo.size()).collect();
        let scene = dataset.checksum();
        checkpoint.check((scene, dataset.space()), &sizes)?;
        let (config, start) = (&checkpoint.config, &checkpoint.gaussians);
        let mut trainer = Self::with_default_room(raster, (dataset, scene), config, start)?;
        trainer.restore(checkpoint)?;
        Ok(trainer)
    }

    /// Takes the state of a checkpoint of the same run.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    pub fn restore(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainError> {
        let (gpu, state) = (self.gpu.clone(), &checkpoint.state);
        self.parameters = Parameters::upload(&checkpoint.gaussians, &gpu)?;
        self.optimizer = Optimizer::new(&gpu, self.splats(), self.config.adam.clone(), self.config.method)?;
        self.optimizer.restore(&gpu, &checkpoint.moments, state.steps)?;
        self.statistics = Statistics::from_values(&gpu, &checkpoint.statistics)?;
        if let (Some(stages), Some(network)) = (&mut self.stages, &checkpoint.network) {
            stages.restore(network, &checkpoint.depths)?;
        }
        self.exposing = match &state.exposure {
            None => None,
            Some(states) => {
                let mut exposing = Exposing::new(&gpu, self.cameras.len(), &self.config.exposure)?;
                exposing.iter_mut().try_for_each(|exposing| exposing.restore(states))?;
                exposing
            }
        };
        if let (Some(refining), Some(state)) = (&mut self.refining, &state.poses) {
            refining.restore(state);
            let [scene, local] = refining.cameras();
            self.set_cameras(&scene, &local);
        }
        if let (Some(masking), Some(state)) = (&mut self.masking, &checkpoint.transients) {
            masking.restore(state, &self.photos)?;
        }
        self.recorder = Recorder::from_state(&gpu, &state.recorder)?;
        self.telemetry = state.telemetry;
        self.queue = state.queue.clone();
        self.rng = state.rng.clone();
        self.iteration = state.iteration;
        self.extent = state.extent;
        self.prune_length = state.prune_length;
        self.has_planes = state.has_planes;
        self.overflowed = state.overflowed;
        self.schedule = Schedule::new(&self.config, self.config.iterations());
        self.caution = 1.0;
        self.slow_down(state.caution);
        self.raster.set_capacity(state.room);
        self.is_whole = true;
        for (member, checkpoint) in self.members.iter_mut().zip(&checkpoint.members) {
            member.restore(checkpoint)?;
        }
        Ok(())
    }

    /// Multiplies the learning rates by `part` from here on.
    pub fn slow_down(&mut self, part: f64) {
        self.caution *= part;
        self.schedule.slow_down(part);
        self.members.iter_mut().for_each(|member| member.slow_down(part));
    }

    /// Whether the learning rates have been lowered.
    pub fn is_slowed(&self) -> bool {
        self.caution < 1.0
    }

    /// Everything that the training resumes from; waits for the GPU. `run` is the caller's own.
    ///
    /// # Errors
    /// [`TrainError::NotFinite`] where a number of the model is not finite, [`TrainError::Unfinished`] after an iteration that
    /// failed, or the device is lost.
    pub fn checkpoint(&mut self, run: serde_json::Value) -> Result<Checkpoint, TrainError> {
        if !self.is_whole {
            return Err(TrainError::Unfinished(self.iteration));
        }
        let gpu = self.gpu.clone();
        let (moments, steps) = self.optimizer.state(&gpu)?;
        let network = self.stages.as_ref().map(ImageStages::network_state).transpose()?;
        let exact = self.stages.as_mut().filter(|_| self.config.deterministic);
        let depths = exact.map(ImageStages::depths).transpose()?.unwrap_or_default();
        let gaussians = self.splats().download(&gpu)?;
        let statistics = self.statistics.values(&gpu)?;
        let exposure = self.exposing.as_ref().map(Exposing::states).transpose()?;
        let poses = self.refining.as_mut().map(Refining::state).transpose()?;
        let transients = self.masking.as_ref().map(Masking::state).transpose()?;
        let recorder = self.recorder.state(&gpu)?;
        // Data read from a lost device looks like any other result.
        gpu.check()?;
        let state = TrainingState {
            iteration: self.iteration,
            space: gaussians.space,
            sh_degree: gaussians.sh_degree,
            gaussians: gaussians.len(),
            steps,
            network_steps: network.as_ref().map(|network| network.steps),
            queue: self.queue.clone(),
            rng: self.rng.clone(),
            extent: self.extent,
            prune_length: self.prune_length,
            has_planes: self.has_planes,
            overflowed: self.overflowed,
            room: self.raster.capacity(),
            caution: self.caution,
            exposure,
            poses,
            transients: transients.as_ref().map(Vec::len),
            depths: depths.iter().map(|(&view, depth)| (view, depth.len())).collect(),
            telemetry: self.telemetry,
            recorder,
        };
        let (config, scene) = (self.config.clone(), self.scene);
        let members = self.members.iter_mut().map(|member| member.checkpoint(serde_json::Value::Null));
        let members = members.collect::<Result<_, _>>()?;
        let checkpoint = Checkpoint {
            config,
            scene,
            gaussians,
            network,
            members,
            run,
            moments,
            statistics,
            depths,
            transients,
            state,
        };
        if checkpoint.is_finite() { Ok(checkpoint) } else { Err(TrainError::NotFinite(self.iteration)) }
    }
}
