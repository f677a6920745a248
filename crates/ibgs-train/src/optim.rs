//! Adam for the Gaussians and the network (method.md sections 1 and 6): one fused kernel a tensor, in place.

use crate::autodiff::SplatGradients;
use crate::tensor::{bind, primitive};
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::config::{AdamConfig, Method, TrainConfig};
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_core::scene::{PerGaussian, Splats};
use ibgs_shaders::bindings::{AdamBindings, FiniteBindings, OpacityResetBindings};
use ibgs_shaders::types::{AdamParams, CountParams, OpacityResetParams};

/// Rates of one step, three a tensor: of the leading values of a row, of the rest (the spherical harmonics beyond the constant), and
/// the share of the rest that is lost, times its rate.
#[derive(Clone, Copy, Debug)]
pub struct Rates(PerGaussian<[f64; 3]>);

impl Rates {
    /// The rates of one iteration; `mean` is in local units, the fixed rates count `factor` times.
    pub fn new(config: &TrainConfig, mean: f64, factor: f64) -> Self {
        let rates = &config.learning_rates;
        let both = |rate: f64| [rate, rate, 0.0];
        let fixed = |rate: f64| both(rate * factor);
        let dc = rates.sh_dc * factor;
        Self(PerGaussian {
            means: both(mean),
            rotations: fixed(rates.rotation),
            log_scales: fixed(rates.scale),
            opacity_logits: fixed(rates.opacity),
            sh: [dc, dc / rates.sh_rest_divisor, config.sh_rest_decay()],
            normals: fixed(rates.normal),
            offsets: both(mean * rates.offset_factor),
        })
    }
}

/// One parameter tensor with its moments.
pub(super) struct Learned {
    pub parameter: Buffer<f32>,
    pub moments: [Buffer<f32>; 2],
    /// Number of values and values a Gaussian.
    pub count: usize,
    pub row: usize,
}

impl Learned {
    /// Moments at zero for a parameter with `row` values a Gaussian.
    fn new(gpu: &Gpu, (parameter, count, row): (Buffer<f32>, usize, usize)) -> Result<Self, GpuError> {
        let moment = || gpu.allocate("Adam moments", count.max(1));
        Ok(Self { parameter, moments: [moment()?, moment()?], count, row })
    }

    /// Records the count of the parameter's values that are not finite.
    fn record_check(&self, pass: &mut Pass, broken: &Buffer<u32>) {
        // The kernel looks at their bits.
        let buffers = FiniteBindings { values: &self.parameter.cast(), broken };
        pass.linear(&buffers, &CountParams { count: self.count as u32 }, self.count);
    }

    /// Reads the moments back.
    fn read(&self, gpu: &Gpu) -> Result<[Vec<f32>; 2], GpuError> {
        let [first, second] = &self.moments;
        Ok([gpu.read(first, self.count)?, gpu.read(second, self.count)?])
    }

    /// Puts moments in place of its own.
    fn restore(&mut self, gpu: &Gpu, [first, second]: &[Vec<f32>; 2]) -> Result<(), GpuError> {
        self.moments = [gpu.upload("Adam moments", first)?, gpu.upload("Adam moments", second)?];
        Ok(())
    }

    /// Records step number `steps`: the first three values of a row with one rate, the others with `rate_rest` and the decay.
    fn record_step(
        &self,
        pass: &mut Pass,
        gradient: Buffer<f32>,
        config: &AdamConfig,
        [rate, rate_rest, decay_rest]: [f64; 3],
        steps: i32,
    ) {
        let correction = |beta: f64| (1.0 / (1.0 - beta.powi(steps))) as f32;
        let params = AdamParams {
            count: self.count as u32,
            row: self.row as u32,
            head: 3,
            rate: rate as f32,
            rate_rest: rate_rest as f32,
            beta1: config.beta1 as f32,
            beta2: config.beta2 as f32,
            eps: config.epsilon as f32,
            correction1: correction(config.beta1),
            correction2: correction(config.beta2),
            decay_rest: decay_rest as f32,
        };
        let [moment1, moment2] = &self.moments;
        let buffers = AdamBindings { gradient: &gradient, values: &self.parameter, moment1, moment2 };
        pass.linear(&buffers, &params, self.count);
        // Else burn could take its memory for something new before the pass is submitted.
        pass.keep(gradient);
    }
}

/// Adam for a single tensor with one rate: the residual network's weights.
pub struct TensorOptimizer {
    tensor: Learned,
    config: AdamConfig,
    steps: i32,
}

impl TensorOptimizer {
    /// Moments at zero, for a parameter of `count` values.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu, parameter: &Buffer<f32>, count: usize, config: AdamConfig) -> Result<Self, GpuError> {
        Ok(Self { tensor: Learned::new(gpu, (parameter.clone(), count, 1))?, config, steps: 0 })
    }

    pub(super) fn record_check(&self, pass: &mut Pass, broken: &Buffer<u32>) {
        self.tensor.record_check(pass, broken);
    }

    pub(super) fn config(&self) -> AdamConfig {
        self.config.clone()
    }

    /// Moments and number of steps; waits for the GPU.
    pub(super) fn state(&self, gpu: &Gpu) -> Result<([Vec<f32>; 2], i32), GpuError> {
        Ok((self.tensor.read(gpu)?, self.steps))
    }

    /// Continues from moments and number of steps.
    pub(super) fn restore(&mut self, gpu: &Gpu, moments: &[Vec<f32>; 2], steps: i32) -> Result<(), GpuError> {
        self.steps = steps;
        self.tensor.restore(gpu, moments)
    }

    /// Records one step of the tensor.
    pub fn record_step(&mut self, pass: &mut Pass, gradient: &CubeTensor, rate: f64) {
        self.steps += 1;
        pass.relabel("adam");
        self.tensor.record_step(pass, bind(gradient), &self.config, [rate, rate, 0.0], self.steps);
    }
}

/// First and second moments of the parameters, on the host; none of those that are not trained.
pub type Moments = PerGaussian<Option<[Vec<f32>; 2]>>;

/// First and second moments of every parameter, and the parameters' own memory.
pub struct Optimizer {
    /// None for those of the planes where these are not trained.
    tensors: PerGaussian<Option<Learned>>,
    config: AdamConfig,
    /// Steps taken by the base and by the planes, which begin later.
    steps: [i32; 2],
}

/// The parameters: memory, values, values of a Gaussian.
fn parameters(splats: &Splats) -> PerGaussian<(Buffer<f32>, usize, usize)> {
    let rows = PerGaussian::rows(splats.coefficients);
    splats.parameters.clone().zip(rows).map(|(parameter, row)| (parameter, row * splats.count, row))
}

impl Optimizer {
    /// Moments at zero; with [`Method::Ibgs`] normals and offsets are trained too.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu, splats: &Splats, config: AdamConfig, method: Method) -> Result<Self, GpuError> {
        let trained = PerGaussian::with_gradients(method == Method::Ibgs);
        let tensors = parameters(splats)
            .zip(trained)
            .try_map(|(parameter, is_trained)| is_trained.then(|| Learned::new(gpu, parameter)).transpose())?;
        Ok(Self { tensors, config, steps: [0; 2] })
    }

    pub(super) fn tensors(&self) -> &PerGaussian<Option<Learned>> {
        &self.tensors
    }

    /// Records the count of all values that are not finite.
    pub(super) fn record_check(&self, pass: &mut Pass, broken: &Buffer<u32>) {
        let trained = self.tensors.as_ref().into_array().into_iter().flatten();
        trained.for_each(|tensor| tensor.record_check(pass, broken));
    }

    /// Moments and numbers of steps; waits for the GPU.
    pub(super) fn state(&self, gpu: &Gpu) -> Result<(Moments, [i32; 2]), GpuError> {
        let read = |tensor: &Option<Learned>| tensor.as_ref().map(|tensor| tensor.read(gpu)).transpose();
        Ok((self.tensors.as_ref().try_map(read)?, self.steps))
    }

    /// Continues from moments and numbers of steps.
    pub(super) fn restore(&mut self, gpu: &Gpu, moments: &Moments, steps: [i32; 2]) -> Result<(), GpuError> {
        self.steps = steps;
        let pairs = self.tensors.as_mut().zip(moments.as_ref()).into_array();
        let mut both = pairs.into_iter().filter_map(|(tensor, moments)| tensor.as_mut().zip(moments.as_ref()));
        both.try_for_each(|(tensor, moments)| tensor.restore(gpu, moments))
    }

    /// The same optimiser for a model whose rows were rearranged, with its moments.
    pub(super) fn rearranged(&self, splats: &Splats, moments: PerGaussian<Option<[Buffer<f32>; 2]>>) -> Self {
        let tensors = parameters(splats).zip(moments).map(|((parameter, count, row), moments)| {
            moments.map(|moments| Learned { parameter, moments, count, row })
        });
        Self { tensors, config: self.config.clone(), steps: self.steps }
    }

    /// Records one step of every parameter that has a gradient.
    pub fn record_step(&mut self, pass: &mut Pass, gradients: SplatGradients, rates: &Rates) {
        let gradients = gradients.parameters.map(|gradient| gradient.map(primitive));
        self.steps[0] += 1;
        self.steps[1] += i32::from(gradients.normals.is_some());
        pass.relabel("adam");
        let each = self.tensors.as_ref().zip(gradients).zip(rates.0).zip(PerGaussian::OF_PLANE);
        for (((tensor, gradient), rates), of_plane) in each.into_array() {
            if let (Some(tensor), Some(gradient)) = (tensor, gradient) {
                let steps = self.steps[usize::from(of_plane)];
                tensor.record_step(pass, bind(&gradient), &self.config, rates, steps);
            }
        }
    }

    /// Clamps every opacity to at most `limit` and clears the opacities' moments.
    pub fn reset_opacity(&self, gpu: &Gpu, limit: f64) {
        let tensor = self.tensors.opacity_logits.as_ref().expect("opacities are trained");
        let params = OpacityResetParams { count: tensor.count as u32, limit: (limit / (1.0 - limit)).ln() as f32 };
        let mut pass = Pass::new(gpu, "opacity reset");
        let [moment1, moment2] = &tensor.moments;
        let buffers = OpacityResetBindings { opacity_logits: &tensor.parameter, moment1, moment2 };
        pass.linear(&buffers, &params, tensor.count);
        pass.submit();
    }
}
