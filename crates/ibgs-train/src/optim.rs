//! Adam for the Gaussians and the network (method.md sections 1 and 6): one fused kernel a tensor, in place. Moments of the
//! Gaussians are packed in 21 bits a value unless the options say otherwise.

use crate::autodiff::SplatGradients;
use crate::tensor::{bind, primitive};
use burn_cubecl::tensor::CubeTensor;
use bytemuck::Pod;
use ibgs_core::config::{AdamConfig, AdamMoments, Method, TrainConfig};
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_core::scene::{PerGaussian, Splats};
use ibgs_shaders::bindings::{
    AdamBindings, AdamHarmonicsBindings, AdamPackedBindings, AdamPackedHarmonicsBindings, FiniteBindings,
    OpacityResetBindings,
};
use ibgs_shaders::types::{AdamParams, CountParams, OpacityResetParams, ViewUniforms};

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

/// A name in checkpoints for each buffer of a tensor's moments.
pub(super) fn moment_names(moments: AdamMoments) -> &'static [&'static str] {
    match moments {
        AdamMoments::Full => &["first", "second"],
        AdamMoments::Packed => &["moments"],
    }
}

/// Values of a row that a thread of the packed form steps.
fn together(row: usize) -> usize {
    if row.is_multiple_of(3) { 3 } else { 1 }
}

/// Words of each of those buffers for a Gaussian with `row` values.
pub(super) fn moment_words(moments: AdamMoments, row: usize) -> usize {
    match moments {
        AdamMoments::Full => row,
        // Three values share two words.
        AdamMoments::Packed if together(row) == 3 => row / 3 * 2,
        AdamMoments::Packed => row,
    }
}

/// One parameter tensor with its moments.
pub(super) struct Learned {
    pub parameter: Buffer<f32>,
    /// How the moments are kept.
    pub form: AdamMoments,
    /// As [`moment_names`]; words are float32 or packed.
    pub moments: Vec<Buffer<u32>>,
    /// Number of values and values a Gaussian.
    pub count: usize,
    pub row: usize,
}

impl Learned {
    /// Moments at zero for a parameter with `row` values a Gaussian.
    fn new(
        gpu: &Gpu,
        (parameter, count, row): (Buffer<f32>, usize, usize),
        form: AdamMoments,
    ) -> Result<Self, GpuError> {
        let mut learned = Self { parameter, form, moments: Vec::new(), count, row };
        let moment = |_: &&str| gpu.allocate("Adam moments", learned.words().max(1));
        learned.moments = moment_names(form).iter().map(moment).collect::<Result<_, _>>()?;
        Ok(learned)
    }

    /// Records the count of the parameter's values that are not finite.
    fn record_check(&self, pass: &mut Pass, broken: &Buffer<u32>) {
        // The kernel looks at their bits.
        let buffers = FiniteBindings { values: &self.parameter.cast(), broken };
        pass.linear(&buffers, &CountParams { count: self.count as u32 }, self.count);
    }

    /// Words of each buffer of moments.
    fn words(&self) -> usize {
        self.count / self.row * moment_words(self.form, self.row)
    }

    /// Reads the moments back.
    fn read(&self, gpu: &Gpu) -> Result<Vec<Vec<u32>>, GpuError> {
        self.moments.iter().map(|moment| gpu.read(moment, self.words())).collect()
    }

    /// Puts moments in place of its own.
    fn restore<T: Pod>(&mut self, gpu: &Gpu, moments: &[Vec<T>]) -> Result<(), GpuError> {
        let uploaded = moments.iter().map(|moment| gpu.upload("Adam moments", bytemuck::cast_slice(moment)));
        self.moments = uploaded.collect::<Result<_, _>>()?;
        Ok(())
    }

    /// Records step number `steps`: the first three values of a row with one rate, the others with `rate_rest` and the decay. The
    /// gradient is by these values, or, of `harmonics`, by the colours.
    fn record_step(
        &self,
        pass: &mut Pass,
        gradient: Buffer<f32>,
        config: &AdamConfig,
        [rate, rate_rest, decay_rest]: [f64; 3],
        steps: i32,
        harmonics: Option<Directions>,
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
            step: steps as u32,
            center: harmonics.map_or([0.0; 3], |of| of.view.center),
            sh_degree: harmonics.map_or(0, |of| of.view.sh_degree),
        };
        self.launch(pass, &gradient, &params, harmonics.map(|of| of.means));
        // Else burn could take its memory for something new before the pass is submitted.
        pass.keep(gradient);
    }

    /// Records the kernel of its form; with `means` the values are spherical harmonics.
    fn launch(&self, pass: &mut Pass, gradient: &Buffer<f32>, params: &AdamParams, means: Option<&Buffer<f32>>) {
        let values = &self.parameter;
        let threads = self.count / together(self.row);
        match (&self.moments[..], means) {
            ([moments], None) => {
                pass.linear(&AdamPackedBindings { gradient, values, moments }, params, threads);
            }
            ([moments], Some(means)) => {
                let buffers = AdamPackedHarmonicsBindings { gradient, values, moments, means };
                pass.linear(&buffers, params, threads);
            }
            ([first, second], None) => {
                let (moment1, moment2) = (&first.cast(), &second.cast());
                pass.linear(&AdamBindings { gradient, values, moment1, moment2 }, params, self.count);
            }
            ([first, second], Some(means)) => {
                let (moment1, moment2) = (&first.cast(), &second.cast());
                let buffers = AdamHarmonicsBindings { gradient, values, moment1, moment2, means };
                pass.linear(&buffers, params, self.count);
            }
            _ => unreachable!("as many as there are names"),
        }
    }
}

/// Where the directions come from in which Gaussians show their spherical harmonics.
#[derive(Clone, Copy)]
struct Directions<'a> {
    means: &'a Buffer<f32>,
    view: &'a ViewUniforms,
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
        Ok(Self { tensor: Learned::new(gpu, (parameter.clone(), count, 1), config.moments)?, config, steps: 0 })
    }

    pub(super) fn record_check(&self, pass: &mut Pass, broken: &Buffer<u32>) {
        self.tensor.record_check(pass, broken);
    }

    pub(super) fn config(&self) -> AdamConfig {
        self.config.clone()
    }

    /// Moments and number of steps; waits for the GPU.
    pub(super) fn state(&self, gpu: &Gpu) -> Result<([Vec<f32>; 2], i32), GpuError> {
        let read = |which: usize| gpu.read(&self.tensor.moments[which].cast(), self.tensor.count);
        Ok(([read(0)?, read(1)?], self.steps))
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
        self.tensor.record_step(pass, bind(gradient), &self.config, [rate, rate, 0.0], self.steps, None);
    }
}

/// The words of the parameters' moments, on the host, by the names of their buffers; none of those that are not trained.
pub type Moments = PerGaussian<Option<Vec<Vec<u32>>>>;

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
        let learned = |parameter| Learned::new(gpu, parameter, config.moments);
        let tensors = parameters(splats)
            .zip(trained)
            .try_map(|(parameter, is_trained)| is_trained.then(|| learned(parameter)).transpose())?;
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
    pub(super) fn rearranged(&self, splats: &Splats, moments: PerGaussian<Option<Vec<Buffer<u32>>>>) -> Self {
        let form = self.config.moments;
        let tensors = parameters(splats).zip(moments).map(|((parameter, count, row), moments)| {
            moments.map(|moments| Learned { parameter, form, moments, count, row })
        });
        Self { tensors, config: self.config.clone(), steps: self.steps }
    }

    /// Records one step of every parameter that has a gradient; they come from this view.
    pub fn record_step(&mut self, pass: &mut Pass, gradients: SplatGradients, rates: &Rates, view: &ViewUniforms) {
        let gradients = gradients.map(|gradient| gradient.map(primitive));
        self.steps[0] += 1;
        self.steps[1] += i32::from(gradients.normals.is_some());
        pass.relabel("adam");
        let means = &self.tensors.means.as_ref().expect("means are trained").parameter;
        let harmonics = PerGaussian { sh: Some(Directions { means, view }), ..PerGaussian::default() };
        let each = self.tensors.as_ref().zip(gradients).zip(rates.0).zip(PerGaussian::OF_PLANE).zip(harmonics);
        // The means last: directions are those of the view, before this step.
        for ((((tensor, gradient), rates), of_plane), harmonics) in each.into_array().into_iter().rev() {
            if let (Some(tensor), Some(gradient)) = (tensor, gradient) {
                let steps = self.steps[usize::from(of_plane)];
                tensor.record_step(pass, bind(&gradient), &self.config, rates, steps, harmonics);
            }
        }
    }

    /// Clamps every opacity to at most `limit` and clears the opacities' moments.
    pub fn reset_opacity(&self, gpu: &Gpu, limit: f64) {
        let tensor = self.tensors.opacity_logits.as_ref().expect("opacities are trained");
        let params = OpacityResetParams { count: tensor.count as u32, limit: (limit / (1.0 - limit)).ln() as f32 };
        let mut pass = Pass::new(gpu, "opacity reset");
        pass.linear(&OpacityResetBindings { opacity_logits: &tensor.parameter }, &params, tensor.count);
        tensor.moments.iter().for_each(|moment| pass.clear(moment));
        pass.submit();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::synthetic;
    use crate::parameters::Parameters;
    use crate::tensor::{from_primitive, upload};
    use ibgs_reference::gpu::gpu;

    #[test]
    fn an_opacity_reset_clears_the_moments_of_opacities_alone() {
        let gpu = gpu();
        let parameters = Parameters::upload(&synthetic(5, 1, 8, 8).0, &gpu).unwrap();
        for moments in [AdamMoments::Full, AdamMoments::Packed] {
            let config = AdamConfig { moments, ..AdamConfig::default() };
            let mut optimizer = Optimizer::new(&gpu, parameters.splats(), config, Method::Ibgs).unwrap();
            let (zero, _) = optimizer.state(&gpu).unwrap();
            let filled = zero.map(|tensor| tensor.map(|buffers| buffers.iter().map(|b| vec![7; b.len()]).collect()));
            optimizer.restore(&gpu, &filled, [3, 2]).unwrap();
            optimizer.reset_opacity(&gpu, 0.01);
            let (kept, steps) = optimizer.state(&gpu).unwrap();
            assert_eq!(steps, [3, 2]);
            let opacities = kept.opacity_logits.iter().flatten().flatten();
            assert!(opacities.copied().eq(vec![0; 5 * moment_names(moments).len()]), "{moments:?}");
            assert_eq!(PerGaussian { opacity_logits: None, ..kept }, PerGaussian { opacity_logits: None, ..filled });
        }
    }

    /// The spherical harmonics step by the directions before the means' step, however far that goes.
    #[test]
    fn coefficients_step_by_the_view_that_their_gradient_is_of() {
        let gpu = gpu();
        let (gaussians, _) = synthetic(5, 2, 8, 8);
        let view = ViewUniforms { sh_degree: 2, ..bytemuck::Zeroable::zeroed() };
        for moments in [AdamMoments::Full, AdamMoments::Packed] {
            let stepped = [0.0, 9.0].map(|rate| {
                let parameters = Parameters::upload(&gaussians, &gpu).unwrap();
                let adam = AdamConfig { moments, ..AdamConfig::default() };
                let config = TrainConfig { adam, ..TrainConfig::default() };
                let mut optimizer =
                    Optimizer::new(&gpu, parameters.splats(), config.adam.clone(), Method::Ibgs).unwrap();
                let gradient = |row: usize| {
                    let values: Vec<f32> = (0..5 * row).map(|i| (i as f32).sin()).collect();
                    Some(from_primitive(upload(&gpu, "gradient", &values, &[5 * row]).unwrap()))
                };
                let mut pass = Pass::new(&gpu, "test");
                let gradients = PerGaussian::gradient_rows().map(gradient);
                optimizer.record_step(&mut pass, gradients, &Rates::new(&config, rate, 1.0), &view);
                pass.submit();
                parameters.splats().download(&gpu).unwrap()
            });
            let [still, moved] = &stepped;
            assert!(still.means == gaussians.means && moved.means != gaussians.means);
            assert!(still.sh == moved.sh && still.sh != gaussians.sh, "{moments:?}");
        }
    }
}
