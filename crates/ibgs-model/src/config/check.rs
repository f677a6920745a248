//! Which values of the options make sense.

use super::{
    ConfigError, DensifyConfig, ExposureConfig, LearningRates, McmcConfig, ResidualConfig, SourceOptions, TrainConfig,
};
use crate::scene::MAX_SH_DEGREE;
use crate::sources::memory::MemoryBudget;
use crate::sources::{MAX_SOURCES, MAX_VISIBLE};
use std::path::Path;

/// What a number must be.
#[derive(Clone, Copy)]
enum Range {
    /// > 0.
    Positive,
    /// >= 0.
    NotNegative,
    /// 0 < v < 1.
    Inside,
    /// 0 <= v <= 1.
    Unit,
    /// 0 <= v < 1.
    Decay,
    /// > 1.
    AboveOne,
}

impl Range {
    fn holds(self, v: f64) -> bool {
        v.is_finite()
            && match self {
                Self::Positive => v > 0.0,
                Self::NotNegative => v >= 0.0,
                Self::Inside => v > 0.0 && v < 1.0,
                Self::Unit => (0.0..=1.0).contains(&v),
                Self::Decay => (0.0..1.0).contains(&v),
                Self::AboveOne => v > 1.0,
            }
    }

    fn advice(self) -> &'static str {
        match self {
            Self::Positive => "it must be a finite number above 0",
            Self::NotNegative => "it must be a finite number, 0 or above",
            Self::Inside => "it must lie between 0 and 1, both excluded",
            Self::Unit => "it must lie between 0 and 1",
            Self::Decay => "it must be at least 0 and below 1",
            Self::AboveOne => "it must be a finite number above 1",
        }
    }
}

/// Carries the file's name into the errors.
struct Check<'a> {
    path: Option<&'a Path>,
}

impl Check<'_> {
    fn require(&self, holds: bool, field: &str, value: impl ToString, advice: &'static str) -> Result<(), ConfigError> {
        if holds {
            return Ok(());
        }
        Err(ConfigError::Invalid {
            path: self.path.map(Path::to_owned),
            field: field.to_owned(),
            value: value.to_string(),
            advice,
        })
    }

    fn numbers(&self, table: &str, rows: &[(&str, f64, Range)]) -> Result<(), ConfigError> {
        rows.iter().try_for_each(|&(field, value, range)| {
            let field = format!("{table}{field}");
            self.require(range.holds(value), &field, value, range.advice())
        })
    }

    /// Intervals divide: 0 is no interval.
    fn intervals(&self, rows: &[(&str, Option<u32>)]) -> Result<(), ConfigError> {
        rows.iter().try_for_each(|&(field, value)| {
            self.require(value != Some(0), field, 0, "it must be at least 1, or left out")
        })
    }
}

impl TrainConfig {
    /// Checks all values; `path` is the file that they are from.
    pub(super) fn validate_from(&self, path: Option<&Path>) -> Result<(), ConfigError> {
        let check = Check { path };
        self.check_counts(&check)?;
        check.intervals(&[
            ("sh-interval", self.sh_interval),
            ("densify.interval", self.densify.interval),
            ("opacity-reset.interval", self.opacity_reset.interval),
            ("learning-rates.mean-iterations", self.learning_rates.mean_iterations),
        ])?;
        check.numbers(
            "",
            &[
                ("ssim-weight", self.ssim_weight, Range::Unit),
                ("initial-opacity", self.start()[0], Range::Inside),
                ("initial-scale", self.start()[1], Range::Positive),
                ("opacity-reset.max-opacity", self.opacity_reset.max_opacity, Range::Inside),
                ("adam.beta1", self.adam.beta1, Range::Decay),
                ("adam.beta2", self.adam.beta2, Range::Decay),
                // As the kernel sees it, in 32 bits.
                ("adam.epsilon", f64::from(self.adam.epsilon as f32), Range::Positive),
            ],
        )?;
        check_rates(&self.learning_rates, &check)?;
        check_densify(&self.densify, &check)?;
        check_sources(&self.sources, &check)?;
        let count = self.surface.intersections;
        let even = matches!(count, 2 | 4 | 6 | 8);
        check.require(even, "surface.intersections", count, "it must be 2, 4, 6 or 8")?;
        let every = self.surface.photometric_every;
        check.require(every > 0, "surface.photometric-every", every, "it must be at least 1")?;
        check.numbers(
            "surface.",
            &[
                ("normal-weight", self.surface.normal_weight, Range::NotNegative),
                ("photometric-weight", self.surface.photometric_weight, Range::NotNegative),
            ],
        )?;
        check_residual(&self.residual, &check)?;
        check_exposure(&self.exposure, &check)
    }

    fn check_counts(&self, check: &Check<'_>) -> Result<(), ConfigError> {
        let at_least_1 = "it must be at least 1";
        check.require(self.iterations() >= 1, "iterations", self.iterations(), at_least_1)?;
        // TOML has signed 64-bit integers, so a larger seed could not be written down.
        let demo = self.demo_exposure_seed.unwrap_or_default();
        for (field, seed) in [("seed", self.seed), ("demo-exposure-seed", demo)] {
            check.require(i64::try_from(seed).is_ok(), field, seed, "it must be below 2^63")?;
        }
        check.require(self.sh_degree() <= MAX_SH_DEGREE, "sh-degree", self.sh_degree(), "it must be 0, 1, 2 or 3")?;
        let every = self.data.eval_split_every;
        check.require(every >= 2, "data.eval-split-every", every, "it must be at least 2")?;
        let side = self.data.max_resolution;
        check.require(side != Some(0), "data.max-resolution", 0, at_least_1)?;
        let extent = self.data.extent;
        let is_length = extent.is_none_or(|extent| extent.is_finite() && extent > 0.0);
        check.require(is_length, "data.extent", extent.unwrap_or_default(), "it must be a finite number above 0")?;
        let keeps_all = !self.deterministic || self.surface.depth_memory == MemoryBudget::Unlimited;
        let memory = String::from(self.surface.depth_memory);
        check.require(keeps_all, "surface.depth-memory", memory, "a deterministic run keeps all depth maps: `none`")?;
        let random = self.data.random_points;
        check.require(random >= 1, "data.random-points", random, at_least_1)?;
        let splats = self.densify.most();
        check.require(splats >= 1, "densify.max-splats", splats, at_least_1)?;
        let listed = [("eval-iterations", &self.eval_iterations), ("save-iterations", &self.save_iterations)];
        listed.into_iter().try_for_each(|(field, list)| {
            let counted = list.iter().flatten().all(|&iteration| iteration >= 1);
            check.require(counted, field, "a list with 0", "iterations count from 1")
        })
    }
}

fn check_rates(rates: &LearningRates, check: &Check<'_>) -> Result<(), ConfigError> {
    check.numbers(
        "learning-rates.",
        &[
            // The schedule is linear in the logarithm.
            ("mean-initial", rates.mean_initial, Range::Positive),
            ("mean-final", rates.mean_final, Range::Positive),
            ("rotation", rates.rotation, Range::NotNegative),
            ("scale", rates.scale, Range::NotNegative),
            ("opacity", rates.opacity, Range::NotNegative),
            ("sh-dc", rates.sh_dc, Range::NotNegative),
            ("sh-rest-divisor", rates.sh_rest_divisor, Range::Positive),
            ("sh-rest-decay", rates.sh_rest_decay.unwrap_or_default(), Range::NotNegative),
            ("factor", rates.factor.unwrap_or(1.0), Range::Positive),
            ("normal", rates.normal, Range::NotNegative),
            ("offset-factor", rates.offset_factor, Range::NotNegative),
        ],
    )
}

fn check_densify(densify: &DensifyConfig, check: &Check<'_>) -> Result<(), ConfigError> {
    check.numbers(
        "densify.",
        &[
            ("grad-threshold", densify.grad_threshold, Range::Positive),
            ("scale-threshold", densify.scale_threshold, Range::NotNegative),
            ("near-depth", densify.near_depth, Range::NotNegative),
            ("abs-grad-threshold", densify.abs_grad_threshold, Range::Positive),
            ("absgs-threshold", densify.absgs_threshold, Range::Positive),
            ("abs-min-radius", densify.abs_min_radius, Range::NotNegative),
            ("split-divisor", densify.split_divisor, Range::AboveOne),
            ("prune-opacity", densify.prune_opacity, Range::Decay),
            ("prune-scale", densify.prune_scale, Range::Positive),
            ("growth.threshold", densify.growth.threshold, Range::Positive),
            ("growth.fraction", densify.growth.fraction, Range::Unit),
            ("growth.prune-opacity", densify.growth.prune_opacity, Range::Decay),
            ("growth.opacity-decay", densify.growth.opacity_decay, Range::Decay),
            ("growth.screen-size", densify.growth.screen_size, Range::NotNegative),
            ("growth.free-space", densify.growth.free_space, Range::Decay),
            ("mcmc.noise", densify.mcmc.noise, Range::NotNegative),
            ("mcmc.opacity-weight", densify.mcmc.opacity_weight, Range::NotNegative),
            ("mcmc.scale-weight", densify.mcmc.scale_weight, Range::NotNegative),
            ("mcmc.dead-opacity", densify.mcmc.dead_opacity, Range::Inside),
            ("mcmc.growth", densify.mcmc.growth.unwrap_or(McmcConfig::LEAST_GROWTH), Range::AboveOne),
        ],
    )
}

fn check_sources(sources: &SourceOptions, check: &Check<'_>) -> Result<(), ConfigError> {
    let angle = sources.max_angle_deg;
    let possible = angle > 0.0 && angle <= 180.0;
    check.require(possible, "sources.max-angle-deg", angle, "it must lie above 0 and at most at 180 degrees")?;
    let SourceOptions { used, neighbours, visible, .. } = *sources;
    check.require((1..=MAX_SOURCES as u32).contains(&used), "sources.used", used, "it must lie between 1 and 8")?;
    check.require(neighbours >= used, "sources.neighbours", neighbours, "it must be at least `sources.used`")?;
    check.require((1..=MAX_VISIBLE).contains(&visible), "sources.visible", visible, "it must lie between 1 and 4")?;
    let (least, most) = (sources.min_distance.unwrap_or(0.0), sources.max_distance.unwrap_or(f64::MAX));
    check.numbers(
        "sources.",
        &[
            ("min-distance", least, Range::NotNegative),
            ("max-distance", most, Range::Positive),
            ("depth-agreement", sources.depth_agreement, Range::Positive),
        ],
    )?;
    check.require(most > least, "sources.max-distance", most, "it must lie above `sources.min-distance`")
}

fn check_residual(residual: &ResidualConfig, check: &Check<'_>) -> Result<(), ConfigError> {
    let factor = residual.factor();
    let known = [1.0, 0.5, 0.25].contains(&factor);
    check.require(known, "residual.factor", factor, "it must be 1, 0.5 or 0.25")?;
    let counted = residual.halve_at.iter().flatten().all(|&iteration| iteration >= 1);
    check.require(counted, "residual.halve-at", "a list with 0", "iterations count from 1")?;
    check.numbers(
        "residual.",
        &[
            ("burn-in-gain", residual.burn_in_gain, Range::Unit),
            ("dropout", residual.dropout, Range::Decay),
            ("dropout-until", residual.dropout_until.unwrap_or(1.0), Range::Unit),
            ("source-share", residual.source_share, Range::Unit),
            ("learning-rate", residual.learning_rate, Range::Positive),
            ("beta1", residual.beta1, Range::Decay),
            ("beta2", residual.beta2, Range::Decay),
            ("epsilon", f64::from(residual.epsilon as f32), Range::Positive),
        ],
    )
}

fn check_exposure(exposure: &ExposureConfig, check: &Check<'_>) -> Result<(), ConfigError> {
    check.numbers(
        "exposure.",
        &[
            ("learning-rate", exposure.learning_rate, Range::Positive),
            ("final-learning-rate", exposure.final_learning_rate, Range::Positive),
            ("beta1", exposure.beta1, Range::Decay),
            ("beta2", exposure.beta2, Range::Decay),
            ("epsilon", f64::from(exposure.epsilon as f32), Range::Positive),
        ],
    )
}
