//! The studied variants of the residual network (method.md section 6).

use serde::{Deserialize, Serialize};

/// What the network reads of each source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Inputs {
    /// The base colour, and how each source's colour differs from it.
    #[default]
    Differences,
    /// The base colour, and each source's colour itself.
    SourceColors,
    /// The differences without the base colour.
    DifferencesOnly,
}

/// What the network's output is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Output {
    /// Added to the base colour.
    #[default]
    Residual,
    /// The final colour itself.
    Color,
}

/// How the sources' features become one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Aggregation {
    /// Their mean.
    #[default]
    Mean,
    /// The largest value of each channel.
    Max,
}
