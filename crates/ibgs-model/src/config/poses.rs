//! Refinement of the photos' cameras.

use super::check::{Check, Range};
use super::error::ConfigError;
use serde::{Deserialize, Serialize};

/// Whether the cameras of the training photos are refined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseSwitch {
    /// Not at all.
    #[default]
    Off,
    /// From `poses.from` on.
    On,
}

/// Refinement of the training photos' poses and focal lengths. A departure from method.md.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct PoseConfig {
    /// Whether the poses of the training photos are refined with the Gaussians, and the focal lengths of the lenses that they
    /// share.
    pub refine: PoseSwitch,
    /// Cameras learn after this iteration; unset: 500, scaled.
    pub from: Option<u32>,
    /// Learning rate at the start, in radians a visit of the photo; lengths are taken by the depth of what it shows.
    pub learning_rate: f64,
    /// Learning rate at the end; it falls evenly in its logarithm.
    pub final_learning_rate: f64,
}

impl PoseConfig {
    /// Which values make sense.
    pub(super) fn check(&self, check: &Check<'_>) -> Result<(), ConfigError> {
        check.numbers(
            "poses.",
            &[
                ("learning-rate", self.learning_rate, Range::Positive),
                ("final-learning-rate", self.final_learning_rate, Range::Positive),
            ],
        )
    }
}

impl Default for PoseConfig {
    fn default() -> Self {
        Self { refine: PoseSwitch::Off, from: None, learning_rate: 5e-4, final_learning_rate: 1e-5 }
    }
}
