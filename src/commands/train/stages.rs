//! Options of the image-based part. The options file has more.

use super::heading;
use super::options::{set, set_some};
use crate::commands::word;
use clap::Args as ClapArgs;
use ibgs_core::config::{ExposureSwitch, PoseSwitch, TrainConfig, TransientSwitch};
use ibgs_core::residual::Precision;
use ibgs_core::sources::find::Distances;
use ibgs_core::sources::memory::MemoryBudget;

/// A value of `--source-distance`.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Distance {
    /// A rule.
    Rule(Distances),
    /// The largest distance, in scene units.
    Most(f64),
}

fn distance(text: &str) -> Result<Distance, String> {
    match text {
        "adaptive" => Ok(Distance::Rule(Distances::Adaptive)),
        "absolute" => Ok(Distance::Rule(Distances::Absolute)),
        number => match number.parse() {
            Ok(most) if most > 0.0 => Ok(Distance::Most(most)),
            _ => Err("give `adaptive`, `absolute` (0.01 to 1.5, as published), or the largest distance".to_owned()),
        },
    }
}

/// Options of the residual and its sources, and of the photos' exposure.
#[derive(ClapArgs, Clone, Debug)]
pub struct StageArgs {
    /// Correct the exposure of the photos: `on`, `off` or `auto` (where they differ) [default: auto].
    #[arg(long, value_parser = word::<ExposureSwitch>(), help_heading = heading::SCENE)]
    exposure: Option<ExposureSwitch>,
    /// Refine the cameras of the training photos, poses and focal lengths: `auto` (before the training, to the observations
    /// of a COLMAP model or to places that photos are found to have in common), `on` (with the Gaussians too where photos have too
    /// little in common) or `off` [default: off].
    #[arg(long, value_parser = word::<PoseSwitch>(), help_heading = heading::SCENE)]
    refine_poses: Option<PoseSwitch>,
    /// Hide what moves, people or cars: a mask is learned for each training photo, which no loss and no other photo's view reads.
    /// `on`, `off` or `auto` (where it is much of the photos) [default: off].
    #[arg(long, value_parser = word::<TransientSwitch>(), help_heading = heading::SCENE)]
    transients: Option<TransientSwitch>,
    /// Neighbouring photos (sources) read for each view, 1 to 8 [default: 4].
    #[arg(long, help_heading = heading::IMAGE_BASED)]
    sources: Option<u32>,
    /// Of these, how many are used at a point: the first that see it, 1 to 4 [default: 3].
    #[arg(long, help_heading = heading::IMAGE_BASED)]
    visible_sources: Option<u32>,
    /// Largest angle between the optical axes of a view and its sources, in degrees [default: 30].
    #[arg(long, help_heading = heading::IMAGE_BASED)]
    source_angle: Option<f64>,
    /// Distance of the sources: `adaptive` (by the spacing of the cameras), `absolute` (0.01 to 1.5, as published), or
    /// the largest one in scene units [default: adaptive].
    #[arg(long, value_parser = distance, help_heading = heading::IMAGE_BASED)]
    source_distance: Option<Distance>,
    /// Median intersections per pixel, at which the sources are read: 2, 4, 6 or 8 [default: 4].
    #[arg(long, help_heading = heading::IMAGE_BASED)]
    intersections: Option<u32>,
    /// Run the residual network at 1, 0.5 or 0.25 of the image's size; below 1 its output is gated [default: 1; with
    /// `--preset fast`, and demo scene on a software adapter, 0.5].
    #[arg(long, help_heading = heading::IMAGE_BASED)]
    residual_factor: Option<f64>,
    /// Precision of the residual network: `full` (float32) or `auto` (half precision on matrix units that pass a test, but
    /// not with `--deterministic`) [default: auto].
    #[arg(long, value_parser = word::<Precision>(), help_heading = heading::IMAGE_BASED)]
    precision: Option<Precision>,
    /// GPU memory for the source photos: `auto` (4 GiB, or 1 GiB where the GPU has no memory of its own), `none` (no
    /// limit), or a size such as `512MiB` [default: auto].
    #[arg(long, help_heading = heading::DEVICE)]
    source_memory: Option<MemoryBudget>,
    /// Memory for decoded photos: `auto` (half of what is free), `none` (no limit), or a size such as `8GiB`; beyond it photos
    /// are decoded again when they are needed [default: auto].
    #[arg(long, help_heading = heading::DEVICE)]
    host_memory: Option<MemoryBudget>,
}

impl StageArgs {
    /// Overrides `c` with the options that are given.
    pub(super) fn apply(&self, c: &mut TrainConfig) {
        set(&mut c.sources.used, &self.sources);
        if let Some(used) = self.sources {
            c.sources.neighbours = c.sources.neighbours.max(used);
        }
        set(&mut c.sources.visible, &self.visible_sources);
        set(&mut c.sources.max_angle_deg, &self.source_angle);
        match self.source_distance {
            Some(Distance::Rule(rule)) => {
                (c.sources.distances, c.sources.min_distance, c.sources.max_distance) = (rule, None, None);
            }
            Some(Distance::Most(most)) => set_some(&mut c.sources.max_distance, &Some(most)),
            None => {}
        }
        set(&mut c.sources.memory, &self.source_memory);
        set(&mut c.data.host_memory, &self.host_memory);
        set(&mut c.surface.intersections, &self.intersections);
        set_some(&mut c.residual.factor, &self.residual_factor);
        set(&mut c.residual.precision, &self.precision);
        set(&mut c.exposure.enabled, &self.exposure);
        set(&mut c.poses.refine, &self.refine_poses);
        set(&mut c.transients.mask, &self.transients);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        stages: StageArgs,
    }

    fn config(line: &str) -> TrainConfig {
        let mut config = TrainConfig::default();
        Line::parse_from(["ibgs"].into_iter().chain(line.split_whitespace())).stages.apply(&mut config);
        config.validate().unwrap();
        config
    }

    #[test]
    fn the_command_line_reaches_the_options() {
        assert_eq!(config(""), TrainConfig::default());
        let c = config("--sources 2 --visible-sources 1 --source-angle 50 --source-distance 4.5 --source-memory 2GiB");
        let s = &c.sources;
        assert_eq!((s.used, s.visible, s.max_angle_deg, s.max_distance), (2, 1, 50.0, Some(4.5)));
        assert_eq!(s.memory, MemoryBudget::Bytes(2 << 30));
        let c = config(
            "--source-distance absolute --intersections 8 --residual-factor 0.5 --exposure on --refine-poses on \
             --transients auto",
        );
        assert_eq!((c.sources.distances, c.sources.max_distance), (Distances::Absolute, None));
        assert_eq!(
            (c.surface.intersections, c.residual.factor, c.exposure.enabled, c.poses.refine),
            (8, Some(0.5), ExposureSwitch::On, PoseSwitch::On)
        );
        assert_eq!(c.transients.mask, TransientSwitch::Auto);
        for line in ["--source-distance far", "--source-distance -1", "--source-memory much"] {
            assert!(Line::try_parse_from(["ibgs"].into_iter().chain(line.split_whitespace())).is_err(), "{line}");
        }
    }
}
