//! The studied variants of the residual network (method.md section 6).

use crate::scene::Harmonics;
use crate::sources::Reach;
pub use ibgs_shaders::{Aggregation, Output};
use serde::{Deserialize, Serialize};

/// The size at which the network runs, relative to the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Factor {
    /// The image's size.
    #[default]
    Full,
    /// Half of width and height.
    Half,
    /// A quarter of width and height.
    Quarter,
}

/// How precisely the network computes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// Float32 throughout.
    #[default]
    Full,
    /// Halves on matrix units, their products summed in float32, where the adapter has such units that pass a test of results
    /// and speed; otherwise as `full`, but frames keep the activations as halves.
    Auto,
}

impl Precision {
    /// Colours of frames that nothing but the eye looks at: halves but with `Full`. The image stays within 1/255.
    pub fn of_colors(self) -> Harmonics {
        match self {
            Self::Full => Harmonics::Full,
            Self::Auto => Harmonics::Half,
        }
    }
}

/// One choice of each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Variant {
    /// What the network gives.
    pub output: Output,
    /// How the sources are joined.
    pub aggregation: Aggregation,
    /// Where it runs.
    pub factor: Factor,
    /// Where its output counts.
    pub reach: Reach,
}

impl Factor {
    /// The factor nearest to a number: 1, 0.5 or 0.25.
    pub fn of(scale: f64) -> Self {
        match scale {
            s if s > 0.75 => Factor::Full,
            s if s > 0.375 => Factor::Half,
            _ => Factor::Quarter,
        }
    }

    /// Size at which the network runs for an image of `size`: rounded, at least 4 (two poolings) unless the image itself
    /// is used as it is.
    pub fn size(self, size: [u32; 2]) -> [u32; 2] {
        let scale = match self {
            Factor::Full => return size,
            Factor::Half => 0.5,
            Factor::Quarter => 0.25,
        };
        size.map(|n| ((f64::from(n) * scale).round() as u32).max(4))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_round_and_never_vanish() {
        assert_eq!(Factor::Full.size([3, 9]), [3, 9]);
        assert_eq!(Factor::Half.size([33, 540]), [17, 270]);
        assert_eq!(Factor::Quarter.size([13, 1008]), [4, 252]);
    }

    #[test]
    fn names_are_those_of_the_configuration() {
        let text = "output = \"gated\"\naggregation = \"soft\"\nfactor = \"half\"\nreach = \"seen\"\n";
        let variant: Variant = toml::from_str(text).unwrap();
        assert_eq!(toml::to_string(&variant).unwrap(), text);
        assert_eq!(toml::from_str::<Variant>("").unwrap(), Variant::default());
        assert!(toml::from_str::<Variant>("factor = \"third\"").is_err());
    }
}
