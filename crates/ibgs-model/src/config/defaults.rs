//! The values of the published experiments (method.md sections 1 and 7), which are the defaults.

use crate::dataset::LoadOptions;

use super::schedule::REFERENCE_ITERATIONS;
use super::{
    AdamConfig, AdamMoments, DensifyConfig, ExposureConfig, LearningRates, Method, OpacityResetConfig, PoseConfig,
    ResidualConfig, SourceOptions, SurfaceConfig, TrainConfig, TransientConfig, WARM_ITERATIONS,
};

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            method: Method::Ibgs,
            iterations: None,
            schedule_scaling: true,
            init: None,
            seed: 0,
            ensemble: None,
            deterministic: false,
            sh_degree: None,
            sh_interval: None,
            background: None,
            ssim_weight: 0.2,
            initial_opacity: None,
            initial_scale: None,
            eval_every: 0,
            eval_iterations: None,
            save_iterations: None,
            source: None,
            demo_exposure_seed: None,
            demo_walkers: 0,
            data: LoadOptions::default(),
            learning_rates: LearningRates::default(),
            adam: AdamConfig::default(),
            densify: DensifyConfig::default(),
            opacity_reset: OpacityResetConfig::default(),
            sources: SourceOptions::default(),
            surface: SurfaceConfig::default(),
            residual: ResidualConfig::default(),
            exposure: ExposureConfig::default(),
            poses: PoseConfig::default(),
            transients: TransientConfig::default(),
        }
    }
}

/// What depends on other options where it is unset.
impl TrainConfig {
    /// Opacity and relative scale of the first Gaussians.
    pub fn start(&self) -> [f64; 2] {
        let [opacity, scale] = self.densify.strategy.defaults().start;
        [self.initial_opacity.unwrap_or(opacity), self.initial_scale.unwrap_or(scale)]
    }

    /// Number of iterations. Where none is given and [`adapt_to_photos`](Self::adapt_to_photos) was not called, that of the
    /// published experiments; with `init` 3000.
    pub fn iterations(&self) -> u32 {
        self.iterations.unwrap_or(if self.init.is_some() { WARM_ITERATIONS } else { REFERENCE_ITERATIONS })
    }

    /// Degree of the spherical harmonics.
    pub fn sh_degree(&self) -> u32 {
        self.sh_degree.unwrap_or(if self.method == Method::Gs3 || self.data.shows_object() { 3 } else { 2 })
    }

    /// Part of the run after which no Gaussian is left out any more: an object's base then gains more than its final image loses.
    pub fn dropout_until(&self) -> f64 {
        self.residual.dropout_until.unwrap_or(if self.data.shows_object() { 0.85 } else { 1.0 })
    }

    /// Share of the coefficients beyond the constant that each iteration removes, times their rate.
    pub fn sh_rest_decay(&self) -> f64 {
        self.learning_rates.sh_rest_decay.unwrap_or(if self.method == Method::Gs3 { 1.0 } else { 0.0 })
    }
}

impl Default for LearningRates {
    fn default() -> Self {
        Self {
            factor: None,
            mean_initial: 1.6e-4,
            mean_final: 1.6e-6,
            mean_iterations: None,
            rotation: 1e-3,
            scale: 5e-3,
            opacity: 2.5e-2,
            sh_dc: 2.5e-3,
            sh_rest_divisor: 20.0,
            sh_rest_decay: None,
            normal: 1e-3,
            offset_factor: 0.5,
        }
    }
}

impl Default for AdamConfig {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-15, moments: AdamMoments::default() }
    }
}
