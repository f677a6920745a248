//! Exposure of the training photos (method.md section 8): two scalars a photo with their optimiser, and the part of the
//! image loss that knows of them.

use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use bytemuck::bytes_of;
use ibgs_shaders::types::{AdamParams, LossParams};
use ibgs_shaders::{ADAM, EXPOSURE_GROUPS, EXPOSURE_L1, EXPOSURE_L1_BACKWARD, EXPOSURE_L1_TOTAL, EXPOSURE_SCALARS};
use serde::{Deserialize, Serialize};

/// Floats from one photo's scalars to the next: a part of a buffer can only be bound at multiples of 256 bytes.
const STRIDE: usize = 64;

/// What the exposed L1 reads.
pub(super) struct Exposed<'a> {
    pub image: &'a Buffer,
    pub photo: &'a Buffer,
    /// (a, b).
    pub scalars: &'a Buffer,
    pub params: &'a LossParams,
}

/// Scratch memory of the exposed L1, the same for every image size.
#[derive(Debug)]
pub(super) struct ExposureScratch {
    partials: Buffer,
    /// `[2]`: gradient by (a, b).
    pub v_scalars: Buffer,
}

impl ExposureScratch {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let partials = gpu.allocate("exposure sums", 8 * u64::from(EXPOSURE_GROUPS))?;
        Ok(Self { partials, v_scalars: gpu.allocate("gradient of the exposure", 8)? })
    }

    /// Records the exchange of the plain L1 in `loss` and `stats`, which the image loss has written.
    pub fn record(&self, pass: &mut Pass, exposed: &Exposed, loss: &Buffer, stats: &Buffer) {
        let Exposed { image, photo, scalars, params } = *exposed;
        let buffers = [image, photo, scalars, &self.partials];
        pass.groups(&EXPOSURE_L1, &buffers, bytes_of(params), EXPOSURE_GROUPS as usize);
        pass.groups(&EXPOSURE_L1_TOTAL, &[&self.partials, loss, stats], bytes_of(params), 1);
    }

    /// Records the exchange of the plain L1's gradient in `v_image`, which the image loss has written, and the gradient
    /// by the scalars.
    pub fn record_backward(
        &self,
        pass: &mut Pass,
        exposed: &Exposed,
        stats: &Buffer,
        v_loss: &Buffer,
        v_image: &Buffer,
    ) {
        let Exposed { image, photo, scalars, params } = *exposed;
        let buffers = [image, photo, scalars, stats, v_loss, v_image, &self.partials];
        pass.groups(&EXPOSURE_L1_BACKWARD, &buffers, bytes_of(params), EXPOSURE_GROUPS as usize);
        pass.groups(&EXPOSURE_SCALARS, &[&self.partials, &self.v_scalars], &[], 1);
    }
}

/// Settings of the scalars' optimiser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureAdam {
    /// Learning rate.
    pub rate: f64,
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the corrected second moment.
    pub eps: f64,
}

impl Default for ExposureAdam {
    fn default() -> Self {
        Self { rate: 1e-3, beta1: 0.9, beta2: 0.99, eps: 1e-8 }
    }
}

/// One photo's scalars on the host, for checkpoints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExposureState {
    /// (a, b) of base' = exp(a) base + b.
    pub scalars: [f32; 2],
    /// First moments of Adam.
    pub moment1: [f32; 2],
    /// Second moments of Adam.
    pub moment2: [f32; 2],
    /// Steps taken.
    pub steps: i32,
}

/// Two exposure scalars (a, b) for every training photo, at first 0, with Adam's moments. A photo's scalars move only
/// when it is visited.
#[derive(Debug)]
pub struct ExposureScalars {
    values: Buffer,
    moments: [Buffer; 2],
    steps: Vec<i32>,
    /// Settings of the steps.
    pub adam: ExposureAdam,
}

impl ExposureScalars {
    /// Scalars of this many photos.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu, photos: usize, adam: ExposureAdam) -> Result<Self, GpuError> {
        Self::from_states(gpu, &vec![ExposureState::default(); photos], adam)
    }

    /// Scalars, moments and steps as [`ExposureScalars::states`] gave them.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn from_states(gpu: &Gpu, states: &[ExposureState], adam: ExposureAdam) -> Result<Self, GpuError> {
        let upload = |what, pair: fn(&ExposureState) -> [f32; 2]| {
            let mut values = vec![0.0f32; STRIDE * states.len().max(1)];
            for (slot, state) in values.chunks_exact_mut(STRIDE).zip(states) {
                slot[..2].copy_from_slice(&pair(state));
            }
            gpu.upload(what, &values)
        };
        Ok(Self {
            values: upload("exposure scalars", |s| s.scalars)?,
            moments: [upload("exposure moments", |s| s.moment1)?, upload("exposure moments", |s| s.moment2)?],
            steps: states.iter().map(|s| s.steps).collect(),
            adam,
        })
    }

    /// Reads everything back; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn states(&self, gpu: &Gpu) -> Result<Vec<ExposureState>, GpuError> {
        let read = |buffer| gpu.read::<f32>(buffer, STRIDE * self.steps.len());
        let (values, first, second) = (read(&self.values)?, read(&self.moments[0])?, read(&self.moments[1])?);
        let pair = |from: &[f32], photo: usize| [from[STRIDE * photo], from[STRIDE * photo + 1]];
        let state = |(photo, steps): (usize, &i32)| ExposureState {
            scalars: pair(&values, photo),
            moment1: pair(&first, photo),
            moment2: pair(&second, photo),
            steps: *steps,
        };
        Ok(self.steps.iter().enumerate().map(state).collect())
    }

    fn part(&self, buffer: &Buffer, photo: usize) -> Buffer {
        assert!(photo < self.steps.len(), "photo {photo} of {}", self.steps.len());
        let offset = buffer.offset + (4 * STRIDE * photo) as u64;
        Buffer { buffer: buffer.buffer.clone(), offset, size: 8 }
    }

    /// (a, b) of one photo, `[2]` f32.
    ///
    /// # Panics
    /// When there is no such photo: a bug of ours.
    pub fn scalars(&self, photo: usize) -> Buffer {
        self.part(&self.values, photo)
    }

    /// Records one step of Adam for one photo's scalars; `gradient` is `[2]` f32.
    ///
    /// # Panics
    /// When there is no such photo: a bug of ours.
    pub fn record_step(&mut self, pass: &mut Pass, photo: usize, gradient: &Buffer) {
        let [first, second] = self.moments.each_ref().map(|m| self.part(m, photo));
        let values = self.scalars(photo);
        self.steps[photo] += 1;
        let correction = |beta: f64| (1.0 / (1.0 - beta.powi(self.steps[photo]))) as f32;
        let params = AdamParams {
            count: 2,
            row: 2,
            head: 2,
            rate: self.adam.rate as f32,
            rate_rest: self.adam.rate as f32,
            beta1: self.adam.beta1 as f32,
            beta2: self.adam.beta2 as f32,
            eps: self.adam.eps as f32,
            correction1: correction(self.adam.beta1),
            correction2: correction(self.adam.beta2),
        };
        pass.linear(&ADAM, &[gradient, &values, &first, &second], bytes_of(&params), 2);
    }
}
