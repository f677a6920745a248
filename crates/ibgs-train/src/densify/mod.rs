//! Densification and pruning: statistics on the GPU, the plan on the host by one of several strategies, the new model
//! gathered on the GPU.
//!
//! A strategy is a file with a [`Strategy`], its line in [`strategy`], and a word and a row of defaults among the options
//! ([`config::Strategy`]).

mod absgs;
pub mod default;
pub mod free_space;
mod gradient;
pub mod mcmc;
mod published;

pub use absgs::AbsGs;
pub use default::Growth;
pub use mcmc::Mcmc;
pub use published::Published;

use super::optim::{Optimizer, moment_words};
use crate::autodiff::SplatGradients;
use crate::parameters::Parameters;
use crate::tensor::{self, bind};
use free_space::FreeSpace;
use glam::{DVec3, Vec3};
use ibgs_core::config::{self, DensifyConfig};
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_core::raster::ScreenStatistics;
use ibgs_core::scene::{PerGaussian, Splats};
use ibgs_shaders::bindings::DensifyGatherBindings;
use ibgs_shaders::types::GatherParams;
use rand_chacha::ChaCha8Rng;
use std::fmt::Debug;

/// Marks a new Gaussian in [`Plan::sources`].
pub const FRESH: u32 = 1 << 31;

/// What the host needs to plan a round, one entry a Gaussian.
#[derive(Clone, Debug, Default)]
pub struct Observations {
    /// What [`Statistics`] kept, see [`Over`].
    pub statistics: Vec<[f32; 4]>,
    /// World positions.
    pub means: Vec<[f32; 3]>,
    /// Raw quaternions, w x y z.
    pub rotations: Vec<[f32; 4]>,
    /// Logarithms of the scales.
    pub log_scales: Vec<[f32; 3]>,
    /// Opacities before the sigmoid.
    pub opacity_logits: Vec<f32>,
}

impl Observations {
    /// Whether place and shape of a Gaussian are finite: a Gaussian that is not could not be saved.
    pub fn is_finite(&self, i: usize) -> bool {
        let finite = |values: &[f32]| values.iter().all(|v| v.is_finite());
        finite(&self.means[i]) && finite(&self.rotations[i]) && finite(&self.log_scales[i])
    }
}

/// Which prunings apply in a round.
#[derive(Clone, Copy, Debug)]
pub struct Round<'a> {
    /// Scene extent in local units.
    pub extent: f64,
    /// The largest scale is `prune-scale` times this length.
    pub prune_length: f64,
    /// Prune by opacity.
    pub transparent: bool,
    /// Prune by scale.
    pub large: bool,
    /// The number of Gaussians may grow.
    pub grows: bool,
    /// Part of the run that is done, 0 to 1.
    pub progress: f64,
    /// Rounds from this one on in the first half of the run.
    pub until_half: u32,
    /// What lies so near to a training camera that nothing can be there, see [`Strategy::free_space`].
    pub free_space: &'a FreeSpace,
}

/// The next model: where each row comes from, and what is not simply copied.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Row of the last model; the top bit marks a new Gaussian.
    pub sources: Vec<u32>,
    /// New means.
    pub means: Vec<[f32; 3]>,
    /// New logarithms of the scales.
    pub log_scales: Vec<[f32; 3]>,
    /// New opacities before the sigmoid; none: those of the sources.
    pub opacity_logits: Option<Vec<f32>>,
    /// Gaussians cloned (or added), split and pruned (or moved elsewhere).
    pub counts: [usize; 3],
}

impl Plan {
    /// Adds a row, for a strategy that gives every opacity.
    pub fn push(&mut self, source: u32, mean: [f32; 3], log_scale: [f32; 3], opacity_logit: f32) {
        self.sources.push(source);
        self.means.push(mean);
        self.log_scales.push(log_scale);
        self.opacity_logits.get_or_insert_default().push(opacity_logit);
    }
}

/// How the statistics of the views since the last round are reduced to one value a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Over {
    /// (sum of gradient norms, sum of absolute-gradient norms, views, largest radius in pixels); gradients in units of half
    /// the image.
    Sum,
    /// (largest absolute-gradient norm, 0, views, largest radius in units of the image's longer side); gradients in units of
    /// the image.
    Largest,
}

/// What [`Statistics::of_views`] keeps of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reduction {
    /// How the views become one.
    pub over: Over,
    /// Gradients of Gaussians nearer than this depth, in local units, count less; for [`Over::Sum`].
    pub near_depth: f64,
}

fn sigmoid(x: f32) -> f64 {
    1.0 / (1.0 + (-f64::from(x)).exp())
}

/// From this many extents on a scene is far from its cameras.
const FAR: f64 = 3.0;

/// The median distance of the Gaussians from the mean camera position `centre` where they are far from the cameras; the extent
/// elsewhere.
pub fn distance_length(means: &[[f32; 3]], centre: DVec3, extent: f64) -> f64 {
    let mut distances: Vec<f64> = means.iter().map(|m| Vec3::from(*m).as_dvec3().distance(centre)).collect();
    if distances.is_empty() {
        return extent;
    }
    let middle = distances.len() / 2;
    let (_, median, _) = distances.select_nth_unstable_by(middle, f64::total_cmp);
    if *median > FAR * extent { *median } else { extent }
}

/// The step that the Gaussians have just taken.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Learning rate of the means, in local units.
    pub mean_rate: f64,
    /// Seed of the run.
    pub seed: u64,
    /// The iteration, from 1.
    pub iteration: u32,
}

/// How Gaussians are added and removed: all that differs between the strategies during a training. When rounds and opacity resets
/// come is said by the options' [`config::StrategyDefaults`].
pub trait Strategy: Debug + Send {
    /// How the views since the last round are reduced; none: the strategy looks at no gradients. `extent` is the scene's in
    /// local units.
    fn reduction(&self, config: &DensifyConfig, extent: f64) -> Option<Reduction>;

    /// Part of the median depth around each training camera that [`Round::free_space`] reaches; 0: there is none.
    fn free_space(&self, _config: &DensifyConfig) -> f64 {
        0.0
    }

    /// Plans a round.
    fn plan(&self, o: &Observations, config: &DensifyConfig, round: &Round<'_>, rng: &mut ChaCha8Rng) -> Plan;

    /// Adds the gradients of its own penalties to those of an iteration. The batch may still hold the latter: burn's operations
    /// on them need a [`flush`](ibgs_core::gpu::flush) before.
    fn penalise(&self, _gradients: &mut SplatGradients, _parameters: &Parameters, _config: &DensifyConfig) {}

    /// Records what it does to the Gaussians after each step.
    fn record_after_step(&self, _pass: &mut Pass, _splats: &Splats, _config: &DensifyConfig, _step: &Step) {}
}

/// The strategy of that name.
pub fn strategy(name: config::Strategy) -> Box<dyn Strategy> {
    match name {
        config::Strategy::Default => Box::new(Growth),
        config::Strategy::Published => Box::new(Published),
        config::Strategy::AbsGs => Box::new(AbsGs),
        config::Strategy::Mcmc => Box::new(Mcmc),
    }
}

/// Running statistics of every Gaussian since the last round.
#[derive(Debug)]
pub struct Statistics {
    values: Buffer<[f32; 4]>,
    count: usize,
}

impl Statistics {
    /// Statistics at zero.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu, count: usize) -> Result<Self, GpuError> {
        Ok(Self { values: gpu.allocate("densification statistics", count.max(1))?, count })
    }

    /// Four values a Gaussian; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn values(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        Ok(gpu.read(&self.values, self.count)?.into_flattened())
    }

    /// Statistics that continue from there.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn from_values(gpu: &Gpu, values: &[f32]) -> Result<Self, GpuError> {
        Ok(Self { values: gpu.upload("densification statistics", values.as_chunks().0)?, count: values.len() / 4 })
    }

    /// Where a backward pass adds its view.
    pub fn of_views(&self, Reduction { over, near_depth }: Reduction) -> ScreenStatistics {
        let (largest, near_depth) = (over == Over::Largest, near_depth as f32);
        ScreenStatistics { values: self.values.clone(), largest, near_depth }
    }

    /// Reads back everything that a plan needs; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn observations(&self, gpu: &Gpu, splats: &Splats) -> Result<Observations, GpuError> {
        let PerGaussian { means, rotations, log_scales, opacity_logits, .. } = &splats.parameters;
        Ok(Observations {
            statistics: gpu.read(&self.values, self.count)?,
            means: gpu.read(&means.cast(), self.count)?,
            rotations: gpu.read(&rotations.cast(), self.count)?,
            log_scales: gpu.read(&log_scales.cast(), self.count)?,
            opacity_logits: gpu.read(opacity_logits, self.count)?,
        })
    }
}

/// Carries a plan out: the new model and its optimiser.
///
/// # Errors
/// Not enough memory.
pub fn apply(
    gpu: &Gpu,
    parameters: &Parameters,
    optimizer: &Optimizer,
    plan: Plan,
) -> Result<(Parameters, Optimizer), GpuError> {
    let (n, splats) = (plan.sources.len(), parameters.splats());
    let sources = gpu.upload("densification plan", &plan.sources)?;
    let mut pass = Pass::new(gpu, "densify");
    let mut gather = |from: &Buffer<u32>, to: &Buffer<u32>, row: usize, fresh_zero: u32| {
        let params = GatherParams { count: (n * row) as u32, row: row as u32, fresh_zero, pad: 0 };
        let buffers = DensifyGatherBindings { sources: &sources, previous: from, next: to };
        pass.linear(&buffers, &params, n * row);
    };
    let moments = optimizer.tensors().as_ref().try_map(|tensor| {
        let Some(tensor) = tensor else { return Ok(None) };
        let words = moment_words(tensor.form, tensor.row);
        let gathered = tensor.moments.iter().map(|from| {
            let to = gpu.allocate("Adam moments", (n * words).max(1))?;
            gather(from, &to, words, 1);
            Ok::<_, GpuError>(to)
        });
        gathered.collect::<Result<Vec<_>, _>>().map(Some)
    })?;
    let planned = PerGaussian {
        means: Some(plan.means.into_flattened()),
        log_scales: Some(plan.log_scales.into_flattened()),
        opacity_logits: plan.opacity_logits,
        ..PerGaussian::default()
    };
    let rows = PerGaussian::rows(splats.coefficients);
    let each = splats.parameters.as_ref().zip(PerGaussian::NAMES).zip(rows).zip(planned);
    let tensors = each.try_map(|(((from, name), row), values)| match values {
        Some(values) => tensor::upload(gpu, name, &values, &[n * row]),
        None => {
            let to = tensor::empty(gpu, name, &[n * row])?;
            gather(&from.cast(), &bind(&to).cast(), row, 0);
            Ok(to)
        }
    })?;
    let next = Parameters::new((splats.space, n, splats.coefficients), tensors);
    pass.submit();
    let optimizer = optimizer.rearranged(next.splats(), moments);
    Ok((next, optimizer))
}
