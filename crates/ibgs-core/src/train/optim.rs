//! Adam for the Gaussians (method.md section 1): one fused kernel a tensor, in place, all in one submit.

use super::config::{AdamConfig, LearningRates};
use crate::gpu::buffer::primitive;
use crate::gpu::{Bound, Buffer, Gpu, GpuError, Pass};
use crate::raster::RasterGradients;
use crate::scene::Splats;
use bytemuck::bytes_of;
use ibgs_shaders::types::{AdamParams, OpacityResetParams};
use ibgs_shaders::{ADAM, OPACITY_RESET};

/// Parameter tensors that base training moves.
pub const TENSORS: usize = 5;
const OPACITY: usize = 3;

/// Rates of one step; `rest` is for the spherical harmonics beyond the constant.
#[derive(Clone, Copy, Debug)]
pub struct Rates {
    /// Means, in world units.
    pub means: f64,
    /// The constant rates.
    pub fixed: [f64; 3],
    /// Constant and higher spherical harmonics.
    pub sh: [f64; 2],
}

impl Rates {
    /// The rates of one iteration.
    pub fn new(rates: &LearningRates, mean: f64) -> Self {
        Self {
            means: mean,
            fixed: [rates.rotation, rates.scale, rates.opacity],
            sh: [rates.sh_dc, rates.sh_dc / rates.sh_rest_divisor],
        }
    }
}

/// First and second moments of every parameter, and the parameters' own memory.
pub struct Optimizer {
    /// (parameter, first moment, second moment) in the order means, rotations, log scales, opacities, SH.
    slots: [Slot; TENSORS],
    config: AdamConfig,
    /// Steps taken.
    steps: i32,
}

/// One parameter tensor with its moments.
pub(super) struct Slot {
    pub parameter: Bound,
    pub moments: [Buffer; 2],
    /// Number of values and values a Gaussian.
    pub count: usize,
    pub row: usize,
}

fn slots(splats: &Splats) -> [(Bound, usize, usize); TENSORS] {
    let gpu_tensors = [
        primitive(splats.means.val()),
        primitive(splats.rotations.val()),
        primitive(splats.log_scales.val()),
        primitive(splats.opacity_logits.val()),
        primitive(splats.sh.val()),
    ];
    gpu_tensors.map(|tensor| {
        let shape = tensor.meta.shape();
        let count: usize = shape.iter().product();
        let row = shape.iter().skip(1).product();
        (Gpu::bind(&tensor), count, row)
    })
}

impl Optimizer {
    /// Moments at zero.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu, splats: &Splats, config: AdamConfig) -> Result<Self, GpuError> {
        let mut made = Vec::with_capacity(TENSORS);
        for (parameter, count, row) in slots(splats) {
            let moment = || gpu.allocate("Adam moments", 4 * count.max(1) as u64);
            made.push(Slot { parameter, moments: [moment()?, moment()?], count, row });
        }
        let slots = made.try_into().unwrap_or_else(|_| unreachable!("one slot a tensor"));
        Ok(Self { slots, config, steps: 0 })
    }

    pub(super) fn slots(&self) -> &[Slot; TENSORS] {
        &self.slots
    }

    /// The same optimiser for a model whose rows were rearranged: `moments` in the order of the slots.
    pub(super) fn rearranged(&self, splats: &Splats, moments: Vec<[Buffer; 2]>) -> Self {
        let mut moments = moments.into_iter();
        let slots = slots(splats).map(|(parameter, count, row)| Slot {
            parameter,
            moments: moments.next().expect("moments of every tensor"),
            count,
            row,
        });
        Self { slots, config: self.config.clone(), steps: self.steps }
    }

    /// Moves every parameter one step.
    pub fn step(&mut self, gpu: &Gpu, gradients: RasterGradients, rates: &Rates) {
        self.steps += 1;
        let RasterGradients { means, rotations, log_scales, opacity_logits, sh, screen: _, planes: _ } = gradients;
        let gradients =
            [primitive(means), primitive(rotations), primitive(log_scales), primitive(opacity_logits), primitive(sh)];
        let bound = gradients.each_ref().map(Gpu::bind);
        let correction = |beta: f64| (1.0 / (1.0 - beta.powi(self.steps))) as f32;
        let [rotation, scale, opacity] = rates.fixed;
        let pairs = [[rates.means; 2], [rotation; 2], [scale; 2], [opacity; 2], rates.sh];
        let mut pass = Pass::new(gpu, "adam");
        for ((slot, gradient), [rate, rate_rest]) in self.slots.iter().zip(&bound).zip(pairs) {
            let params = AdamParams {
                count: slot.count as u32,
                row: slot.row as u32,
                head: 3,
                rate: rate as f32,
                rate_rest: rate_rest as f32,
                beta1: self.config.beta1 as f32,
                beta2: self.config.beta2 as f32,
                eps: self.config.epsilon as f32,
                correction1: correction(self.config.beta1),
                correction2: correction(self.config.beta2),
            };
            let [first, second] = &slot.moments;
            let buffers: [&Buffer; 4] = [gradient, &slot.parameter, first, second];
            pass.linear(&ADAM, &buffers, bytes_of(&params), slot.count);
        }
        pass.submit();
    }

    /// Clamps every opacity to at most `limit` and clears the opacities' moments.
    pub fn reset_opacity(&self, gpu: &Gpu, limit: f64) {
        let slot = &self.slots[OPACITY];
        let params = OpacityResetParams { count: slot.count as u32, limit: (limit / (1.0 - limit)).ln() as f32 };
        let mut pass = Pass::new(gpu, "opacity reset");
        let [first, second] = &slot.moments;
        pass.linear(&OPACITY_RESET, &[&slot.parameter, first, second], bytes_of(&params), slot.count);
        pass.submit();
    }
}
