//! The exposures of the training photos on the device, with their optimiser.

use super::{Exposure, ROWS};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_shaders::bindings::AdamBindings;
use ibgs_shaders::types::AdamParams;
use serde::{Deserialize, Serialize};

/// Rows from one photo's exposure to the next: a part of a buffer can only be bound at multiples of 256 bytes.
const STRIDE: usize = 16;

/// Settings of the exposures' optimiser, but for its rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureAdam {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the corrected second moment.
    pub eps: f64,
}

impl Default for ExposureAdam {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.99, eps: 1e-8 }
    }
}

/// One photo's exposure on the host, with its moments, for checkpoints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExposureState {
    /// The exposure.
    pub exposure: Exposure,
    /// First moments of Adam, in the same order.
    pub moment1: Exposure,
    /// Second moments of Adam, in the same order.
    pub moment2: Exposure,
    /// Steps taken.
    pub steps: i32,
}

impl ExposureState {
    /// Whether all its numbers are finite.
    pub fn is_finite(&self) -> bool {
        [self.exposure, self.moment1, self.moment2].iter().all(Exposure::is_finite)
    }
}

/// The exposure of every training photo, with Adam's moments. Each starts without a correction and changes only when
/// its photo is visited.
#[derive(Debug)]
pub struct PhotoExposures {
    values: Buffer<[f32; 4]>,
    moments: [Buffer<[f32; 4]>; 2],
    steps: Vec<i32>,
    /// Settings of the steps.
    pub adam: ExposureAdam,
}

impl PhotoExposures {
    /// Exposures of this many photos.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu, photos: usize, adam: ExposureAdam) -> Result<Self, GpuError> {
        Self::from_states(gpu, &vec![ExposureState::default(); photos], adam)
    }

    /// Exposures, moments and steps as [`PhotoExposures::states`] gave them.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn from_states(gpu: &Gpu, states: &[ExposureState], adam: ExposureAdam) -> Result<Self, GpuError> {
        let upload = |what, of: fn(&ExposureState) -> &Exposure| {
            let mut values = vec![[0.0; 4]; STRIDE * states.len().max(1)];
            for (rows, state) in values.chunks_exact_mut(STRIDE).zip(states) {
                rows[..ROWS].copy_from_slice(&of(state).rows());
            }
            gpu.upload(what, &values)
        };
        Ok(Self {
            values: upload("exposures", |s| &s.exposure)?,
            moments: [upload("exposure moments", |s| &s.moment1)?, upload("exposure moments", |s| &s.moment2)?],
            steps: states.iter().map(|s| s.steps).collect(),
            adam,
        })
    }

    /// Reads everything back; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn states(&self, gpu: &Gpu) -> Result<Vec<ExposureState>, GpuError> {
        let [exposures, first, second] =
            [self.read(gpu, &self.values)?, self.read(gpu, &self.moments[0])?, self.read(gpu, &self.moments[1])?];
        let state = |(photo, &steps): (usize, &i32)| ExposureState {
            exposure: exposures[photo],
            moment1: first[photo],
            moment2: second[photo],
            steps,
        };
        Ok(self.steps.iter().enumerate().map(state).collect())
    }

    /// Reads the exposures back; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn exposures(&self, gpu: &Gpu) -> Result<Vec<Exposure>, GpuError> {
        self.read(gpu, &self.values)
    }

    fn read(&self, gpu: &Gpu, buffer: &Buffer<[f32; 4]>) -> Result<Vec<Exposure>, GpuError> {
        let values = gpu.read(buffer, STRIDE * self.steps.len())?;
        Ok(values.chunks_exact(STRIDE).map(Exposure::from_rows).collect())
    }

    /// One photo's rows.
    ///
    /// # Panics
    /// When there is no such photo: a bug of ours.
    pub(super) fn rows(&self, photo: usize) -> Buffer<[f32; 4]> {
        self.part(&self.values, photo)
    }

    fn part(&self, buffer: &Buffer<[f32; 4]>, photo: usize) -> Buffer<[f32; 4]> {
        assert!(photo < self.steps.len(), "photo {photo} of {}", self.steps.len());
        buffer.part(STRIDE * photo, ROWS)
    }

    /// Records one step of Adam for one photo's exposure; `gradient` are its rows.
    ///
    /// # Panics
    /// When there is no such photo: a bug of ours.
    pub fn record_step(&mut self, pass: &mut Pass, photo: usize, gradient: &Buffer<[f32; 4]>, rate: f64) {
        // Adam steps one number at a time.
        let [first, second] = self.moments.each_ref().map(|m| self.part(m, photo).cast());
        let (gradient, values) = (&gradient.cast(), self.rows(photo).cast());
        self.steps[photo] += 1;
        let correction = |beta: f64| (1.0 / (1.0 - beta.powi(self.steps[photo]))) as f32;
        let count = 4 * ROWS as u32;
        let params = AdamParams {
            count,
            row: count,
            head: count,
            rate: rate as f32,
            rate_rest: rate as f32,
            beta1: self.adam.beta1 as f32,
            beta2: self.adam.beta2 as f32,
            eps: self.adam.eps as f32,
            correction1: correction(self.adam.beta1),
            correction2: correction(self.adam.beta2),
            decay_rest: 0.0,
            step: self.steps[photo] as u32,
            center: [0.0; 3],
            sh_degree: 0,
        };
        let bindings = AdamBindings { gradient, values: &values, moment1: &first, moment2: &second };
        pass.linear(&bindings, &params, 4 * ROWS);
    }
}
