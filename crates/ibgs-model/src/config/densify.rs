//! Options of densification: strategies, their rounds and constants, opacity resets (method.md section 7).

use super::ConfigError;
use super::check::{Check, Range};
use serde::{Deserialize, Serialize};

/// Makes the enum, with a list of the strategies and what their documentation says, for help and reference.
macro_rules! strategies {
    ($($(#[doc = $text:literal])+ $name:ident,)+) => {
        /// How Gaussians are added and removed.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(rename_all = "lowercase")]
        pub enum Strategy {
            #[default]
            $($(#[doc = $text])+ $name,)+
        }

        impl Strategy {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$name),+];

            /// What it does.
            pub fn meaning(self) -> &'static str {
                match self {
                    $(Self::$name => concat!($($text),+).trim_start(),)+
                }
            }
        }
    };
}

strategies! {
    /// Splits by the largest gradient of any view, prunes and replaces in every round, lets opacities fade, resets nothing
    /// (method.md section 7).
    Default,
    /// As in the paper: clones and splits by mean gradients of the projected means and, where Gaussians are wide, by absolute
    /// gradients (method.md section 7).
    Published,
    /// AbsGS (Ye et al., 2024): splits large Gaussians by the absolute gradient alone, without conditions on radius and number;
    /// clones small ones by the signed gradient.
    AbsGs,
    /// 3D Gaussian splatting as Markov chain Monte Carlo (Kheradmand et al., 2024): nothing is cloned, split or pruned. Transparent
    /// Gaussians move onto others that are drawn by opacity, and the number grows to the cap. Penalties on opacity and scale are
    /// added to the gradients, and noise moves the means after each step.
    Mcmc,
}

/// What the options say with a strategy where they leave it open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrategyDefaults {
    /// The number of Gaussians grows before this iteration of a reference run.
    pub end: u32,
    /// Iterations between two rounds.
    pub interval: u32,
    /// Rounds move apart as the learning rates fall, so that there are as many as at full rates.
    pub rounds_follow_rates: bool,
    /// Start and interval of densification in short runs.
    pub short_runs: ShortRuns,
    /// Rounds go on to the end of the run, without growth.
    pub rounds_to_end: bool,
    /// Opacities are reset while the number of Gaussians grows.
    pub resets_opacity: bool,
    /// Gaussians in all.
    pub max_splats: u32,
    /// The photos choose that number.
    pub cap_follows_photos: bool,
    /// The photos choose the length of the run and the factor on the learning rates.
    pub length_follows_photos: bool,
    /// Opacity and relative scale of the first Gaussians.
    pub start: [f64; 2],
}

/// How start and interval of densification fall in short runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShortRuns {
    /// As all milestones, in runs under 5000 iterations.
    AsMilestones,
    /// In proportion to the length, in runs under 4000 iterations: every short run has the same number of rounds, so that the
    /// model grows as far.
    SameRounds,
}

/// Those of the published experiments.
const PUBLISHED: StrategyDefaults = StrategyDefaults {
    end: 15_000,
    interval: 100,
    rounds_follow_rates: false,
    short_runs: ShortRuns::AsMilestones,
    rounds_to_end: false,
    resets_opacity: true,
    max_splats: 5_000_000,
    cap_follows_photos: false,
    length_follows_photos: false,
    start: [0.1, 1.0],
};

impl Strategy {
    /// The strategy's row in the table of what the options leave open.
    pub fn defaults(self) -> StrategyDefaults {
        match self {
            Self::Default => StrategyDefaults {
                end: 21_000,
                interval: 200,
                rounds_follow_rates: true,
                short_runs: ShortRuns::SameRounds,
                rounds_to_end: true,
                resets_opacity: false,
                cap_follows_photos: true,
                length_follows_photos: true,
                ..PUBLISHED
            },
            Self::Published | Self::AbsGs => PUBLISHED,
            Self::Mcmc => StrategyDefaults {
                end: 25_000,
                resets_opacity: false,
                max_splats: 1_000_000,
                cap_follows_photos: true,
                start: [0.5, 0.1],
                ..PUBLISHED
            },
        }
    }
}

/// Densification and pruning (method.md section 7). Lengths are multiples of the scene extent, gradients are by the
/// projected mean in units of half the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct DensifyConfig {
    /// How Gaussians are added and removed.
    pub strategy: Strategy,
    /// Rounds come after this iteration; unset: 500, scaled only in short runs.
    pub start: Option<u32>,
    /// The number of Gaussians grows before this iteration; unset: by the strategy, scaled.
    pub end: Option<u32>,
    /// Rounds come at multiples of this; unset: by the strategy, with `default` more in proportion where `learning-rates.factor`
    /// is under 1; scaled only in short runs.
    pub interval: Option<u32>,
    /// Mean gradient norm from which a Gaussian is cloned or split.
    pub grad_threshold: f64,
    /// Gradients of Gaussians nearer than this view depth, times the extent, count by the square of their depth over it:
    /// it keeps clouds from growing right in front of a camera; 0: all count in full. A departure from method.md.
    pub near_depth: f64,
    /// Largest scale that is cloned, times the extent; larger ones are split.
    pub scale_threshold: f64,
    /// Split by the absolute gradient too.
    pub abs_split: bool,
    /// Mean norm of the absolute gradient from which a Gaussian is split.
    pub abs_grad_threshold: f64,
    /// With AbsGS: mean norm of the absolute gradient from which a large Gaussian is split.
    pub absgs_threshold: f64,
    /// Such a split needs a screen radius above this, in pixels.
    pub abs_min_radius: f64,
    /// Most such splits in one round.
    pub abs_max_per_round: u32,
    /// A split divides the scales by this.
    pub split_divisor: f64,
    /// Gaussians in all; unset: by the strategy, or by the photos: one for each 45 pixels of the training photos, 200,000 to 3
    /// million.
    pub max_splats: Option<u32>,
    /// Gaussians below this opacity are removed.
    pub prune_opacity: f64,
    /// Gaussians with a larger scale, times the extent, are removed after `prune-scale-after`.
    pub prune_scale: f64,
    /// Measure that scale by the median distance of the first Gaussians from the mean camera where that is over three extents:
    /// the extent of a capture that faces forward says nothing about its scene. A departure from method.md.
    pub prune_scale_by_distance: bool,
    /// Pruning by scale begins after this iteration; unset: the interval of the opacity resets.
    pub prune_scale_after: Option<u32>,
    /// What only the strategy `default` uses.
    pub growth: GrowthConfig,
    /// What only the strategy `mcmc` uses.
    pub mcmc: McmcConfig,
}

impl DensifyConfig {
    /// Gaussians in all.
    pub fn most(&self) -> u32 {
        self.max_splats.unwrap_or(self.strategy.defaults().max_splats)
    }

    /// Which values make sense.
    pub(super) fn check(&self, check: &Check<'_>) -> Result<(), ConfigError> {
        check.numbers(
            "densify.",
            &[
                ("grad-threshold", self.grad_threshold, Range::Positive),
                ("scale-threshold", self.scale_threshold, Range::NotNegative),
                ("near-depth", self.near_depth, Range::NotNegative),
                ("abs-grad-threshold", self.abs_grad_threshold, Range::Positive),
                ("absgs-threshold", self.absgs_threshold, Range::Positive),
                ("abs-min-radius", self.abs_min_radius, Range::NotNegative),
                ("split-divisor", self.split_divisor, Range::AboveOne),
                ("prune-opacity", self.prune_opacity, Range::Decay),
                ("prune-scale", self.prune_scale, Range::Positive),
                ("growth.threshold", self.growth.threshold, Range::Positive),
                ("growth.fraction", self.growth.fraction, Range::Unit),
                ("growth.prune-opacity", self.growth.prune_opacity, Range::Decay),
                ("growth.opacity-decay", self.growth.opacity_decay, Range::Decay),
                ("growth.screen-size", self.growth.screen_size, Range::NotNegative),
                ("growth.free-space", self.growth.free_space, Range::Decay),
                ("mcmc.noise", self.mcmc.noise, Range::NotNegative),
                ("mcmc.opacity-weight", self.mcmc.opacity_weight, Range::NotNegative),
                ("mcmc.scale-weight", self.mcmc.scale_weight, Range::NotNegative),
                ("mcmc.dead-opacity", self.mcmc.dead_opacity, Range::Inside),
                ("mcmc.growth", self.mcmc.growth.unwrap_or(McmcConfig::LEAST_GROWTH), Range::AboveOne),
            ],
        )
    }
}

/// Constants of the strategy `default`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct GrowthConfig {
    /// Largest norm of the absolute gradient over the views, in units of the image, from which a Gaussian may be split.
    pub threshold: f64,
    /// Share of those that is split in a round.
    pub fraction: f64,
    /// Gaussians below this opacity are removed.
    pub prune_opacity: f64,
    /// What every opacity loses in a round, times the part of the run that is left.
    pub opacity_decay: f64,
    /// Gaussians with a larger radius, in units of the image's longer side, are always split; 0: none are.
    pub screen_size: f64,
    /// Gaussians nearer to a training camera than this part of the median depth of the points in its image are removed, except
    /// where points are as near; 0: none are.
    pub free_space: f64,
}

/// Constants of the strategy `mcmc`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct McmcConfig {
    /// Noise of the means, times their learning rate.
    pub noise: f64,
    /// Weight of the mean opacity in the loss.
    pub opacity_weight: f64,
    /// Weight of the mean scale in the loss.
    pub scale_weight: f64,
    /// Gaussians up to this opacity are moved elsewhere.
    pub dead_opacity: f64,
    /// Factor by which the number of Gaussians grows in a round; unset: the one that reaches the cap by half of the
    /// run, at least 1.05.
    pub growth: Option<f64>,
}

/// Opacity resets (method.md section 7).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct OpacityResetConfig {
    /// Resets come at multiples of this, before densification ends; unset: 3000, scaled.
    pub interval: Option<u32>,
    /// Opacity is clamped to at most this.
    pub max_opacity: f64,
}

impl McmcConfig {
    /// Factor by which the number of Gaussians grows in a round at the least, where the options give none.
    pub const LEAST_GROWTH: f64 = 1.05;
}

impl Default for DensifyConfig {
    fn default() -> Self {
        Self {
            strategy: Strategy::Default,
            start: None,
            end: None,
            interval: None,
            grad_threshold: 2e-4,
            near_depth: 1.0,
            scale_threshold: 0.001,
            abs_split: true,
            abs_grad_threshold: 8e-4,
            absgs_threshold: 4e-4,
            abs_min_radius: 20.0,
            abs_max_per_round: 50_000,
            split_divisor: 1.6,
            max_splats: None,
            prune_opacity: 0.05,
            prune_scale: 0.1,
            prune_scale_by_distance: true,
            prune_scale_after: None,
            growth: GrowthConfig::default(),
            mcmc: McmcConfig::default(),
        }
    }
}

impl Default for GrowthConfig {
    fn default() -> Self {
        Self {
            threshold: 0.002,
            fraction: 0.25,
            prune_opacity: 1.0 / 255.0,
            opacity_decay: 0.004,
            screen_size: 0.5,
            free_space: 0.2,
        }
    }
}

impl Default for McmcConfig {
    fn default() -> Self {
        Self { noise: 5e5, opacity_weight: 0.01, scale_weight: 0.01, dead_opacity: 0.005, growth: None }
    }
}

impl Default for OpacityResetConfig {
    fn default() -> Self {
        Self { interval: None, max_opacity: 0.01 }
    }
}
