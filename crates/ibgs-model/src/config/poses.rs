//! Refinement of the photos' cameras.

use super::check::{Check, Range};
use super::error::ConfigError;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Whether the cameras of the training photos are refined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseSwitch {
    /// Not at all.
    #[default]
    Off,
    /// Before the training, to what photos have in common, where cameras then fit it clearly better.
    Auto,
    /// As `Auto`, and with the Gaussians where photos have too little in common.
    On,
}

/// Refinement of the training photos' poses and focal lengths. A departure from method.md.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct PoseConfig {
    /// Whether the poses of the training photos are refined, and the focal lengths of the lenses that they share. `auto`: before the
    /// training, to the observations of a COLMAP model or to places that photos are found to have in common, where cameras then fit
    /// them clearly better; `on`: with the Gaussians too where photos have too little in common.
    pub refine: PoseSwitch,
    /// File with the cameras of all photos, in the form of a model's `cameras.json`, in place of the scene's: they were refined before.
    /// The blocks of a scene have theirs so.
    pub cameras: Option<PathBuf>,
    /// Cameras learn after this iteration; unset: 500, scaled.
    pub from: Option<u32>,
    /// Cameras learn up to this iteration; unset: to the end.
    pub until: Option<u32>,
    /// Learning rate at the start, in radians a visit of the photo; lengths are taken by the depth of what it shows.
    pub learning_rate: f64,
    /// Learning rate at the last iteration in which they learn; it falls evenly in its logarithm.
    pub final_learning_rate: f64,
    /// Steps of a camera are scaled by this power of the part, 0 to 1, that the gradients of its last visits agree by; 0: not scaled.
    pub agreement: f64,
}

impl PoseConfig {
    /// Whether the photos of a training may have other cameras than in the scene.
    pub fn change(&self) -> bool {
        self.refine != PoseSwitch::Off || self.cameras.is_some()
    }

    /// Which values make sense.
    pub(super) fn check(&self, check: &Check<'_>) -> Result<(), ConfigError> {
        let are_final = self.cameras.is_none() || self.refine == PoseSwitch::Off;
        check.require(
            are_final,
            "poses.refine",
            format!("{:?}", self.refine).to_lowercase(),
            "it must be `off` where `poses.cameras` names cameras that were refined before",
        )?;
        check.numbers(
            "poses.",
            &[
                ("learning-rate", self.learning_rate, Range::Positive),
                ("final-learning-rate", self.final_learning_rate, Range::Positive),
                ("agreement", self.agreement, Range::NotNegative),
            ],
        )
    }
}

impl Default for PoseConfig {
    fn default() -> Self {
        Self {
            refine: PoseSwitch::Off,
            cameras: None,
            from: None,
            until: None,
            learning_rate: 1e-3,
            final_learning_rate: 1e-5,
            agreement: 1.0,
        }
    }
}
