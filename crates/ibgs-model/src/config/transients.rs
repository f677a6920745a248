//! Learned masks of what moves.

use super::TrainConfig;
use super::check::Check;
use super::error::ConfigError;
use serde::{Deserialize, Serialize};

/// Whether the training hides what a photo shows and no other does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TransientSwitch {
    /// Not at all.
    #[default]
    Off,
    /// Where it is much of the photos.
    Auto,
    /// Wherever it is found.
    On,
}

/// Learned masks of what moves: people, cars, their shadows. A departure from method.md.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct TransientConfig {
    /// Whether a mask is learned for each training photo, which hides what it shows and other photos do not; `auto`: where that is
    /// much of the photos. Photos of an object have none.
    pub mask: TransientSwitch,
    /// Masks are learned after this iteration; unset: 1500, scaled.
    pub from: Option<u32>,
}

impl TransientConfig {
    /// Which values make sense.
    pub(super) fn check(&self, config: &TrainConfig, check: &Check<'_>) -> Result<(), ConfigError> {
        let holds = self.mask != TransientSwitch::On || !config.data.shows_object();
        let advice = "photos of an object have masks of their own: leave it out, or say what else they show \
                      (`data.masks`, `data.alpha`)";
        check.require(holds, "transients.mask", "on", advice)
    }
}
