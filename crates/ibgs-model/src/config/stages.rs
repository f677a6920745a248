//! Options of the image-based stages, surface losses and residual network (method.md sections 3, 6 and 7), and of exposure.

use super::ConfigError;
use super::check::{Check, Range};
use crate::residual::variant::{Aggregation, Output, Precision};
use crate::sources::memory::MemoryBudget;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Median intersections and the losses on the surface that they give (method.md sections 3 and 7).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct SurfaceConfig {
    /// Median intersections of a pixel: K, even, 2 to 8.
    pub intersections: u32,
    /// The surface losses begin after this iteration; unset: 7000, scaled.
    pub start: Option<u32>,
    /// The normal loss begins after this iteration, and not before `start`; unset: with `start`.
    pub normal_from: Option<u32>,
    /// Weight of the normal loss (published: 0.03).
    pub normal_weight: f64,
    /// Weight of the photometric loss (published: 0.3).
    pub photometric_weight: f64,
    /// The photometric loss is part of every N-th iteration, with N times its weight (published: 1).
    pub photometric_every: u32,
    /// Device memory for the median depths of the training views, as `sources.memory`; none: all are kept. One that was dropped
    /// is rendered again when it is needed, by the Gaussians of that moment, so a limit changes what is learned.
    pub depth_memory: MemoryBudget,
}

/// Least rows of a band.
const LEAST_BAND: u32 = 128;

/// The residual network and its training (method.md sections 6 and 7).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ResidualConfig {
    /// File of a trained network to begin with, such as `residual_network.safetensors` of a model with the same `output`; unset:
    /// one that has learned nothing.
    pub init: Option<PathBuf>,
    /// The residual begins after this iteration; unset: 10000, scaled, and with the strategy `default` not before it has 250 visits
    /// of each photo or fewer left, with `burn-in` and `halve-at` in proportion.
    pub start: Option<u32>,
    /// Number of iterations in which only the network learns from the final image; unset: 3000, scaled, and with `init` 0; 0: none.
    pub burn_in: Option<u32>,
    /// Gain of the base image when the burn-in begins; it rises to 1 (published: 0.5, for a network that passes nothing at first).
    pub burn_in_gain: f64,
    /// Learning rate of the network.
    pub learning_rate: f64,
    /// Iterations at which the rate is halved; unset: 18000 and 25000, scaled.
    pub halve_at: Option<Vec<u32>>,
    /// Decay of Adam's first moment.
    pub beta1: f64,
    /// Decay of Adam's second moment.
    pub beta2: f64,
    /// Added to the root of Adam's second moment.
    pub epsilon: f64,
    /// Share of the Gaussians that each iteration of the residual leaves out at random, 0 to below 1, so that the base errs in
    /// training as it does on views it was not trained on; 0: none, as published. A departure from method.md.
    pub dropout: f64,
    /// Part of the run after which none are left out any more; unset: 1, and 0.85 where the photos show an object.
    pub dropout_until: Option<f64>,
    /// Size at which the network runs: 1, 0.5 or 0.25 of the image's; unset: the largest at which a frame takes less than about
    /// 50 ms, and 1 on a software adapter, in blocks, in runs that are `deterministic`, and with `init`.
    pub factor: Option<f64>,
    /// Bands of rows of a training view, of which each iteration makes the final image of one, drawn at random: 1 to 8; 1: of the
    /// whole view, as published. A band has 128 rows or more. A departure from method.md.
    pub bands: u32,
    /// Number of members of the ensemble that have a network and a surface, 1 to `ensemble`: the final image has the mean of their
    /// residuals. A departure from method.md.
    pub networks: u32,
    /// In training; `auto`: in half precision on matrix units where they pass a test, else only the activations of rendered views are
    /// halves, not in runs that are `deterministic`; `full`: float32.
    pub precision: Precision,
    /// What its output is: `residual`, as published; `gated`, a residual and a share of the sources' mean difference,
    /// which is taken at the image's size. Unset: `residual` at the factor 1, `gated` at a smaller one.
    pub output: Option<Output>,
    /// How the sources' features become one: `soft`, their mean by a learned confidence; `mean`, as published.
    pub aggregation: Aggregation,
    /// Most weight of the sources' mean colour in a rendered view, 0 to 1; 0: none, as published.
    pub source_share: f64,
}

/// Whether the photos' exposures are corrected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExposureSwitch {
    /// Not at all.
    Off,
    /// In the whole run.
    On,
    /// In the whole run, where a trial with photos left out says that it helps.
    #[default]
    Auto,
}

/// Exposure of the photos (method.md section 8).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ExposureConfig {
    /// Whether exposures are corrected; `auto`: where a trial with photos left out says that it helps.
    pub enabled: ExposureSwitch,
    /// Exposures are learned after this iteration; unset: 1000, scaled.
    pub from: Option<u32>,
    /// Learning rate at the start.
    pub learning_rate: f64,
    /// Learning rate at the end; it falls evenly in its logarithm.
    pub final_learning_rate: f64,
    /// Decay of Adam's first moment.
    pub beta1: f64,
    /// Decay of Adam's second moment.
    pub beta2: f64,
    /// Added to the root of Adam's second moment.
    pub epsilon: f64,
}

impl SurfaceConfig {
    /// Sets what is published otherwise.
    pub(super) fn publish(&mut self) {
        (self.normal_weight, self.photometric_weight) = (0.03, 0.3);
        self.photometric_every = 1;
    }

    /// Which values make sense.
    pub(super) fn check(&self, check: &Check<'_>) -> Result<(), ConfigError> {
        let count = self.intersections;
        let even = matches!(count, 2 | 4 | 6 | 8);
        check.require(even, "surface.intersections", count, "it must be 2, 4, 6 or 8")?;
        let every = self.photometric_every;
        check.require(every > 0, "surface.photometric-every", every, "it must be at least 1")?;
        check.numbers(
            "surface.",
            &[
                ("normal-weight", self.normal_weight, Range::NotNegative),
                ("photometric-weight", self.photometric_weight, Range::NotNegative),
            ],
        )
    }
}

impl ResidualConfig {
    /// Size at which the network runs, relative to the image's.
    pub fn factor(&self) -> f64 {
        self.factor.unwrap_or(1.0)
    }

    /// What the network gives.
    pub fn output(&self) -> Output {
        self.output.unwrap_or(if self.factor() < 1.0 { Output::Gated } else { Output::Residual })
    }

    /// Bands of a view of this height, and rows of each: as many as all, where bands may overlap by some.
    pub fn bands_of(&self, height: u32) -> (u32, u32) {
        let bands = self.bands.min(height / LEAST_BAND).max(1);
        (bands, height.div_ceil(bands))
    }

    /// Which values make sense.
    pub(super) fn check(&self, check: &Check<'_>) -> Result<(), ConfigError> {
        let factor = self.factor();
        let known = [1.0, 0.5, 0.25].contains(&factor);
        check.require(known, "residual.factor", factor, "it must be 1, 0.5 or 0.25")?;
        check.require((1..=8).contains(&self.bands), "residual.bands", self.bands, "it must lie between 1 and 8")?;
        let counted = self.halve_at.iter().flatten().all(|&iteration| iteration >= 1);
        check.require(counted, "residual.halve-at", "a list with 0", "iterations count from 1")?;
        check.numbers(
            "residual.",
            &[
                ("burn-in-gain", self.burn_in_gain, Range::Unit),
                ("dropout", self.dropout, Range::Decay),
                ("dropout-until", self.dropout_until.unwrap_or(1.0), Range::Unit),
                ("source-share", self.source_share, Range::Unit),
                ("learning-rate", self.learning_rate, Range::Positive),
                ("beta1", self.beta1, Range::Decay),
                ("beta2", self.beta2, Range::Decay),
                ("epsilon", f64::from(self.epsilon as f32), Range::Positive),
            ],
        )
    }
}

impl ExposureConfig {
    /// Which values make sense.
    pub(super) fn check(&self, check: &Check<'_>) -> Result<(), ConfigError> {
        check.numbers(
            "exposure.",
            &[
                ("learning-rate", self.learning_rate, Range::Positive),
                ("final-learning-rate", self.final_learning_rate, Range::Positive),
                ("beta1", self.beta1, Range::Decay),
                ("beta2", self.beta2, Range::Decay),
                ("epsilon", f64::from(self.epsilon as f32), Range::Positive),
            ],
        )
    }
}

impl Default for SurfaceConfig {
    fn default() -> Self {
        Self {
            intersections: 4,
            start: None,
            normal_from: None,
            normal_weight: 0.01,
            photometric_weight: 0.05,
            photometric_every: 4,
            depth_memory: MemoryBudget::Unlimited,
        }
    }
}

impl Default for ResidualConfig {
    fn default() -> Self {
        Self {
            init: None,
            start: None,
            burn_in: None,
            burn_in_gain: 1.0,
            learning_rate: 1e-3,
            halve_at: None,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-8,
            dropout: 0.1,
            dropout_until: None,
            factor: None,
            bands: 1,
            networks: 1,
            precision: Precision::Auto,
            output: None,
            aggregation: Aggregation::Soft,
            source_share: 0.15,
        }
    }
}

impl Default for ExposureConfig {
    fn default() -> Self {
        Self {
            enabled: ExposureSwitch::Auto,
            from: None,
            learning_rate: 1e-2,
            final_learning_rate: 1e-3,
            beta1: 0.9,
            beta2: 0.99,
            epsilon: 1e-8,
        }
    }
}
