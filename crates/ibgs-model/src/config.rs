//! The options of a training run: every constant of method.md, with its reference default.
//!
//! Written to `config.toml` of the output folder and read back from there. A milestone that is left out
//! follows the number of iterations (see [`Schedule`](schedule::Schedule)).

mod adapt;
mod background;
mod check;
mod defaults;
mod densify;
mod difference;
mod ensemble;
mod error;
mod file;
mod image;
mod poses;
mod preset;
mod removed;
pub mod schedule;
mod stages;
mod transients;

pub use crate::sources::find::SourceOptions;
pub use adapt::LengthReason;
pub use background::Background;
pub use densify::{DensifyConfig, GrowthConfig, McmcConfig, OpacityResetConfig, ShortRuns, Strategy, StrategyDefaults};
pub use difference::OptionDifference;
pub use error::ConfigError;
pub use poses::{PoseConfig, PoseSwitch};
pub use preset::Preset;
pub use stages::{ExposureConfig, ExposureSwitch, ResidualConfig, SurfaceConfig};
pub use transients::{TransientConfig, TransientSwitch};

use crate::dataset::LoadOptions;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What is trained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// Image-based Gaussian splatting: the base colour and a residual from the photos of neighbouring views.
    #[default]
    #[serde(rename = "ibgs")]
    Ibgs,
    /// Plain 3D Gaussian splatting: the base colour alone (method.md section 2).
    #[serde(rename = "3dgs")]
    Gs3,
}

/// All options of a training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct TrainConfig {
    /// What is trained.
    pub method: Method,
    /// Number of iterations, counted from 1; unset: 130 for each training photo, 5000 to 11000, with two bases, otherwise, and
    /// for photos with alpha, 200, 7000 to 30000; with another strategy than `default` or without scaling 30000; with `init` 3000.
    pub iterations: Option<u32>,
    /// Milestones follow `iterations / 30000`; otherwise they keep their absolute values.
    pub schedule_scaling: bool,
    /// Gaussians of this scene to start from, a file or a model, of which an ensemble's bases become one and the exposures stay;
    /// they are neither densified nor reset; unset: the scene's points.
    pub init: Option<PathBuf>,
    /// Seed of view order and sampling.
    pub seed: u64,
    /// Number of bases, 1 to 8, trained side by side, each on its own: the base image is their mean, which keeps less of what is
    /// chance in each. Those beyond `residual.networks` are plain splatting, by this strategy (at most 7000 iterations) and by
    /// `mcmc` in turn, of an object by `mcmc` first, and have half of the weight together; unset: 2 in runs of the image-based
    /// method with the strategy `default`, 1 with `init`, for photos with alpha and on a software adapter. A departure from method.md.
    pub ensemble: Option<u32>,
    /// The run repeats bit for bit on the same adapter and build, even when it is resumed: it computes in float32 only,
    /// and checkpoints hold the depth maps of the training views.
    pub deterministic: bool,
    /// Degree of the spherical harmonics, 0 to 3; unset: 2, and 3 with `method = "3dgs"` and where the photos show an object.
    pub sh_degree: Option<u32>,
    /// Iterations between two degrees; unset: 1000, scaled.
    pub sh_interval: Option<u32>,
    /// The colour behind the Gaussians: `white`, `black`, `R,G,B`, or `random`; unset: white where the scene is a Blender one
    /// with transparent photos, the photos' own where they lie on one colour, else black.
    pub background: Option<Background>,
    /// Weight of 1 - SSIM in the image loss; L1 has the rest.
    pub ssim_weight: f64,
    /// Opacity of the first Gaussians; unset: by the strategy.
    pub initial_opacity: Option<f64>,
    /// Scale of the first Gaussians, times the distance of their neighbours; unset: by the strategy.
    pub initial_scale: Option<f64>,
    /// Evaluate every N iterations; 0: only at `eval-iterations`.
    pub eval_every: u32,
    /// Iterations to evaluate at besides the last; unset: 7000, scaled.
    pub eval_iterations: Option<Vec<u32>>,
    /// Iterations to save the model at besides the last; unset: 7000, scaled.
    pub save_iterations: Option<Vec<u32>>,
    /// Scene folder or a ZIP archive of one; unset: the built-in demo scene.
    pub source: Option<PathBuf>,
    /// Gives every photo of the demo scene another exposure, by this seed; unset: the same for all.
    pub demo_exposure_seed: Option<u64>,
    /// Percent of the demo scene's training photos, 0 to 100, that show a walker: a figure with its shadow that stands in one photo
    /// alone. Held-out photos never show one.
    pub demo_walkers: u32,
    /// How the scene is loaded.
    pub data: LoadOptions,
    /// Learning rates.
    pub learning_rates: LearningRates,
    /// The optimiser.
    pub adam: AdamConfig,
    /// Densification and pruning.
    pub densify: DensifyConfig,
    /// Opacity resets.
    pub opacity_reset: OpacityResetConfig,
    /// Which training views are the sources of a view, and how they are read.
    pub sources: SourceOptions,
    /// Median intersections and surface losses.
    pub surface: SurfaceConfig,
    /// The residual network.
    pub residual: ResidualConfig,
    /// Exposure correction.
    pub exposure: ExposureConfig,
    /// Refinement of cameras.
    pub poses: PoseConfig,
    /// Learned masks of what moves.
    pub transients: TransientConfig,
}

/// Learning rates (method.md section 1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct LearningRates {
    /// Factor on the rates of Gaussians and exposures; unset: 1, and less in long runs of the default strategy.
    pub factor: Option<f64>,
    /// Means at the start, times the scene extent.
    pub mean_initial: f64,
    /// Means at the end, times the scene extent.
    pub mean_final: f64,
    /// Iterations from the first to the last rate of the means; unset: 30000, scaled.
    pub mean_iterations: Option<u32>,
    /// Quaternions.
    pub rotation: f64,
    /// Logarithms of the scales.
    pub scale: f64,
    /// Opacity logits.
    pub opacity: f64,
    /// Constant coefficients of the spherical harmonics.
    pub sh_dc: f64,
    /// The other coefficients have the rate `sh-dc` divided by this.
    pub sh_rest_divisor: f64,
    /// Share of the other coefficients that each iteration removes, times their rate: a surface that few photos show from few
    /// directions keeps a constant colour; unset: 0, with `method = "3dgs"` 1. A departure from method.md.
    pub sh_rest_decay: Option<f64>,
    /// Plane normals.
    pub normal: f64,
    /// Plane offsets have the rate of the means times this.
    pub offset_factor: f64,
}

/// Constants of Adam for the Gaussians (method.md section 1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct AdamConfig {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub epsilon: f64,
    /// How both moments of a value are kept: `packed` in 21 bits, rounded at random so that their expectations stay; `full` as two
    /// float32, as published.
    pub moments: AdamMoments,
}

/// How Adam keeps its moments of the Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AdamMoments {
    /// Two float32, as published.
    Full,
    /// Both moments of a value in 21 bits, rounded at random so that their expectations stay. A departure from method.md.
    #[default]
    Packed,
}

/// Iterations of a run that starts from a finished model.
const WARM_ITERATIONS: u32 = 3_000;

impl TrainConfig {
    /// Colour behind the Gaussians in rendered views.
    pub fn background(&self) -> [f32; 3] {
        self.background.unwrap_or(Background::BLACK).shown().map(|level| f32::from(level) / 255.0)
    }

    /// How its scene is loaded.
    pub fn load_options(&self) -> LoadOptions {
        LoadOptions { seed: self.seed, ..self.data.clone() }
    }

    /// Checks all values.
    ///
    /// # Errors
    /// [`ConfigError::Invalid`] for the first value that makes no sense.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.validate_from(None)
    }
}
