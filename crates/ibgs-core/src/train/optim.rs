//! Adam for the Gaussians and the network (method.md sections 1 and 6): one fused kernel a tensor, in place.

use super::config::{AdamConfig, LearningRates};
use crate::gpu::buffer::primitive;
use crate::gpu::{Bound, Buffer, Gpu, GpuError, Pass};
use crate::raster::RasterGradients;
use crate::scene::Splats;
use burn_cubecl::tensor::CubeTensor;
use bytemuck::bytes_of;
use ibgs_shaders::types::{AdamParams, OpacityResetParams};
use ibgs_shaders::{ADAM, OPACITY_RESET};

/// Slots of the base colour and of the planes: normals and offsets.
const BASE: usize = 5;
const PLANES: usize = 2;
const OPACITY: usize = 3;

/// Rates of one step, a pair a slot: the second is for the spherical harmonics beyond the constant.
#[derive(Clone, Copy, Debug)]
pub struct Rates([[f64; 2]; BASE + PLANES]);

impl Rates {
    /// The rates of one iteration; `mean` is in world units, the fixed rates count `factor` times.
    pub fn new(rates: &LearningRates, mean: f64, factor: f64) -> Self {
        let fixed = |rate: f64| [rate * factor; 2];
        let dc = rates.sh_dc * factor;
        Self([
            [mean; 2],
            fixed(rates.rotation),
            fixed(rates.scale),
            fixed(rates.opacity),
            [dc, dc / rates.sh_rest_divisor],
            fixed(rates.normal),
            [mean * rates.offset_factor; 2],
        ])
    }
}

impl Slot {
    fn params(&self, config: &AdamConfig, rate: f64, steps: i32) -> AdamParams {
        let correction = |beta: f64| (1.0 / (1.0 - beta.powi(steps))) as f32;
        AdamParams {
            count: self.count as u32,
            row: self.row as u32,
            head: self.row as u32,
            rate: rate as f32,
            rate_rest: rate as f32,
            beta1: config.beta1 as f32,
            beta2: config.beta2 as f32,
            eps: config.epsilon as f32,
            correction1: correction(config.beta1),
            correction2: correction(config.beta2),
        }
    }
}

/// Adam for a single tensor with one rate: the residual network's weights.
pub struct TensorOptimizer {
    slot: Slot,
    config: AdamConfig,
    steps: i32,
}

impl TensorOptimizer {
    /// Moments at zero.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu, parameter: &CubeTensor, config: AdamConfig) -> Result<Self, GpuError> {
        let count: usize = parameter.meta.shape().iter().product();
        let moment = || gpu.allocate("Adam moments", 4 * count.max(1) as u64);
        let slot = Slot { parameter: Gpu::bind(parameter), moments: [moment()?, moment()?], count, row: 1 };
        Ok(Self { slot, config, steps: 0 })
    }

    /// Moves the tensor one step.
    pub fn step(&mut self, gpu: &Gpu, gradient: &CubeTensor, rate: f64) {
        self.steps += 1;
        let params = self.slot.params(&self.config, rate, self.steps);
        let [first, second] = &self.slot.moments;
        let mut pass = Pass::new(gpu, "adam");
        let buffers: [&Buffer; 4] = [&Gpu::bind(gradient), &self.slot.parameter, first, second];
        pass.linear(&ADAM, &buffers, bytes_of(&params), self.slot.count);
        pass.submit();
    }
}

/// First and second moments of every parameter, and the parameters' own memory.
pub struct Optimizer {
    /// Means, rotations, log scales, opacities, SH and, where planes are trained, normals and offsets.
    slots: Vec<Slot>,
    config: AdamConfig,
    /// Steps taken by the base and by the planes, which begin later.
    steps: [i32; 2],
}

/// One parameter tensor with its moments.
pub(super) struct Slot {
    pub parameter: Bound,
    pub moments: [Buffer; 2],
    /// Number of values and values a Gaussian.
    pub count: usize,
    pub row: usize,
}

fn parameters(splats: &Splats, planes: bool) -> Vec<(Bound, usize, usize)> {
    let mut tensors = vec![
        primitive(splats.means.val()),
        primitive(splats.rotations.val()),
        primitive(splats.log_scales.val()),
        primitive(splats.opacity_logits.val()),
        primitive(splats.sh.val()),
    ];
    if planes {
        tensors.extend([primitive(splats.normals.val()), primitive(splats.offsets.val())]);
    }
    let slot = |tensor: CubeTensor| {
        let shape = tensor.meta.shape();
        let count: usize = shape.iter().product();
        let row = shape.iter().skip(1).product();
        (Gpu::bind(&tensor), count, row)
    };
    tensors.into_iter().map(slot).collect()
}

impl Optimizer {
    /// Moments at zero; `planes`: normals and offsets are trained too.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu, splats: &Splats, config: AdamConfig, planes: bool) -> Result<Self, GpuError> {
        let slot = |(parameter, count, row): (Bound, usize, usize)| {
            let moment = || gpu.allocate("Adam moments", 4 * count.max(1) as u64);
            Ok(Slot { parameter, moments: [moment()?, moment()?], count, row })
        };
        let slots = parameters(splats, planes).into_iter().map(slot).collect::<Result<_, GpuError>>()?;
        Ok(Self { slots, config, steps: [0; 2] })
    }

    pub(super) fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// The same optimiser for a model whose rows were rearranged: `moments` in the order of the slots.
    pub(super) fn rearranged(&self, splats: &Splats, moments: Vec<[Buffer; 2]>) -> Self {
        let parameters = parameters(splats, self.slots.len() > BASE).into_iter();
        let slot = |((parameter, count, row), moments)| Slot { parameter, moments, count, row };
        let slots = parameters.zip(moments).map(slot).collect();
        Self { slots, config: self.config.clone(), steps: self.steps }
    }

    /// Moves every parameter that has a gradient one step.
    pub fn step(&mut self, gpu: &Gpu, gradients: RasterGradients, rates: &Rates) {
        let RasterGradients { means, rotations, log_scales, opacity_logits, sh, screen: _, planes } = gradients;
        let mut tensors = vec![
            primitive(means),
            primitive(rotations),
            primitive(log_scales),
            primitive(opacity_logits),
            primitive(sh),
        ];
        self.steps[0] += 1;
        if let Some((normals, offsets)) = planes {
            tensors.extend([primitive(normals), primitive(offsets)]);
            self.steps[1] += 1;
        }
        let mut pass = Pass::new(gpu, "adam");
        for (i, ((slot, gradient), [rate, rate_rest])) in self.slots.iter().zip(&tensors).zip(rates.0).enumerate() {
            let steps = self.steps[usize::from(i >= BASE)];
            let params = AdamParams { head: 3, rate_rest: rate_rest as f32, ..slot.params(&self.config, rate, steps) };
            let [first, second] = &slot.moments;
            let buffers: [&Buffer; 4] = [&Gpu::bind(gradient), &slot.parameter, first, second];
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
