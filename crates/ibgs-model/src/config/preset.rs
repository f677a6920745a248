//! Sets of options under a name.

use super::schedule::REFERENCE_ITERATIONS;
use super::{AdamMoments, ExposureSwitch, Strategy, TrainConfig};
use crate::dataset::InitialPoints;
use crate::residual::variant::{Aggregation, Output};
use crate::sources::find::{Distances, Draw};
use serde::{Deserialize, Serialize};

/// A set of options under a name. What it leaves out has its default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// The defaults: a length that follows the photos.
    #[default]
    Default,
    /// The highest image in about four times the default's time: two trainings with a network, and four more bases.
    Best,
    /// A good image after half a minute on a fast GPU: the network at half of the image's size.
    Fast,
    /// The published experiments: 30,000 iterations, densification with opacity resets, the published weights of the losses and
    /// choice of sources by distances in scene units. The network still begins with weights that pass the sources'
    /// differences, and exposures are not corrected.
    Published,
}

impl Preset {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Default, Self::Best, Self::Fast, Self::Published];
}

/// Iterations of [`Preset::Fast`].
const FAST_ITERATIONS: u32 = 6_000;

impl TrainConfig {
    /// The options of a preset.
    pub fn preset(preset: Preset) -> Self {
        let mut config = Self::default();
        match preset {
            Preset::Default => {}
            Preset::Best => {
                (config.ensemble, config.residual.networks) = (Some(6), 2);
            }
            Preset::Fast => {
                (config.iterations, config.residual.factor) = (Some(FAST_ITERATIONS), Some(0.5));
                config.ensemble = Some(1);
            }
            Preset::Published => config.publish(),
        }
        config
    }

    /// Sets the options of method.md that have another default here.
    fn publish(&mut self) {
        self.iterations = Some(REFERENCE_ITERATIONS);
        self.adam.moments = AdamMoments::Full;
        self.learning_rates.sh_rest_decay = Some(0.0);
        self.data.initial_points = InitialPoints::Scene;
        self.densify.strategy = Strategy::Published;
        self.densify.near_depth = 0.0;
        self.densify.prune_scale_by_distance = false;
        self.sources.distances = Distances::Absolute;
        self.sources.draw = Draw::Nearest;
        self.surface.publish();
        self.residual.factor = Some(1.0);
        self.residual.burn_in_gain = 0.5;
        self.residual.dropout = 0.0;
        self.residual.output = Some(Output::Residual);
        self.residual.aggregation = Aggregation::Mean;
        self.residual.source_share = 0.0;
        self.exposure.enabled = ExposureSwitch::Off;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::schedule::Schedule;

    #[test]
    fn every_preset_is_valid_and_survives_its_file() {
        for preset in Preset::ALL {
            let config = TrainConfig::preset(preset);
            config.validate().unwrap();
            let text = config.to_text().unwrap();
            assert_eq!(TrainConfig::from_text(&text, "preset.toml".as_ref()).unwrap(), config, "{preset:?}");
        }
        assert_eq!(TrainConfig::preset(Preset::Default), TrainConfig::default());
    }

    #[test]
    fn the_published_one_has_the_published_milestones() {
        let mut config = TrainConfig::preset(Preset::Published);
        config.adapt_to_photos(43, 1);
        let schedule = Schedule::new(&config, config.iterations());
        assert_eq!((config.iterations, config.learning_rates.factor), (Some(30_000), None));
        assert_eq!((schedule.surface_from(), schedule.residual_from()), (Some(7_001), Some(10_001)));
        assert_eq!(schedule.burn_in(10_001).map(|gain| (gain * 100.0).round()), Some(50.0));
        assert!(schedule.reset_opacity_at(3_000) && !schedule.reset_opacity_at(15_000));
    }

    #[test]
    fn a_small_network_is_gated_unless_told_otherwise() {
        let output = |preset, factor| {
            let mut config = TrainConfig::preset(preset);
            config.residual.factor = factor;
            config.residual.output()
        };
        assert_eq!(TrainConfig::preset(Preset::Fast).residual.output(), Output::Gated);
        assert_eq!([None, Some(1.0)].map(|factor| output(Preset::Default, factor)), [Output::Residual; 2]);
        assert_eq!(output(Preset::Default, Some(0.25)), Output::Gated);
        assert_eq!(output(Preset::Published, Some(0.5)), Output::Residual);
    }
}
