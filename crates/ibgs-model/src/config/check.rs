//! Which values of the options make sense. Tables with a file of their own say it there, beside their fields.

use super::{ConfigError, LearningRates, SourceOptions, TrainConfig};
use crate::scene::MAX_SH_DEGREE;
use crate::sources::memory::MemoryBudget;
use crate::sources::{MAX_SOURCES, MAX_VISIBLE};
use std::path::Path;

/// What a number must be.
#[derive(Clone, Copy)]
pub(super) enum Range {
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
pub(super) struct Check<'a> {
    path: Option<&'a Path>,
}

impl Check<'_> {
    pub(super) fn require(
        &self,
        holds: bool,
        field: &str,
        value: impl ToString,
        advice: &'static str,
    ) -> Result<(), ConfigError> {
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

    pub(super) fn numbers(&self, table: &str, rows: &[(&str, f64, Range)]) -> Result<(), ConfigError> {
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
        self.check_ensemble(&check)?;
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
        self.densify.check(&check)?;
        check_sources(&self.sources, &check)?;
        self.surface.check(&check)?;
        self.residual.check(&check)?;
        self.exposure.check(&check)?;
        self.poses.check(&check)?;
        self.transients.check(self, &check)
    }

    fn check_counts(&self, check: &Check<'_>) -> Result<(), ConfigError> {
        let at_least_1 = "it must be at least 1";
        check.require(self.iterations() >= 1, "iterations", self.iterations(), at_least_1)?;
        // TOML has signed 64-bit integers, so a larger seed could not be written down.
        let demo = self.demo_exposure_seed.unwrap_or_default();
        for (field, seed) in [("seed", self.seed), ("demo-exposure-seed", demo)] {
            check.require(i64::try_from(seed).is_ok(), field, seed, "it must be below 2^63")?;
        }
        let walkers = self.demo_walkers;
        check.require(walkers <= 100, "demo-walkers", walkers, "it must lie between 0 and 100")?;
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
