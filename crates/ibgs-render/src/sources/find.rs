//! Neighbour choice: which training views are the sources of a target view (method.md section 4).
//!
//! The published thresholds on the distance, 0.01 and 1.5, are in scene units, which mean nothing: on the LLFF fern they
//! leave most views with one source or none, on a scene of one unit across they let everything pass. The adaptive rule, the
//! default, measures the capture instead:
//!
//! - least distance: [`LEAST`] times the spacing, the median distance of a training camera to its nearest other one. A photo
//!   from almost the same place shows almost the same picture; trained on such sources the network learns to copy.
//! - most distance: [`REACH`] times the median, over the training views, of the distance to the candidate that would be the
//!   last one kept. Sources come nearest first, so this bounds only how far a view at the rim of the capture reaches.
//! - a view with fewer candidates than are used takes the next nearest beyond that distance. The test of depths decides at
//!   every pixel what a far source is worth, while a view without any source has no residual at all.
//!
//! The angle is never relaxed: beyond it photos show other sides. Views without a source are left as they are.

use super::memory::MemoryBudget;
use crate::camera::Camera;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Least distance of a source in the adaptive rule, times the spacing of the training cameras. The published 0.01 is this on
/// the fox.
pub const LEAST: f64 = 0.03;
/// Most distance of a source in the adaptive rule, times the median distance of the last candidate kept.
pub const REACH: f64 = 2.0;
/// The published least and most distance in scene units.
pub const PUBLISHED_DISTANCES: [f64; 2] = [0.01, 1.5];

/// How the thresholds on the distance come about, where they are not given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Distances {
    /// From the spacing of the training cameras; views with too few candidates reach farther.
    #[default]
    Adaptive,
    /// The published 0.01 and 1.5 in scene units; views without a candidate have no source.
    Absolute,
}

/// Which candidates an iteration of training reads. Rendering reads the first ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Draw {
    /// Others each time: the network learns how far to trust photos from other positions. A departure from method.md.
    #[default]
    Random,
    /// The first ones, as published.
    Nearest,
}

/// Options of the neighbour choice and of reading the sources (method.md sections 4 and 5).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct SourceOptions {
    /// Largest angle between the optical axes, in degrees (published: 30, and 50 for Deep Blending and Shiny).
    pub max_angle_deg: f64,
    /// Where the distances below come from when they are unset.
    pub distances: Distances,
    /// Least distance of the camera centres, in scene units; unset: by `distances`.
    pub min_distance: Option<f64>,
    /// Most distance of the camera centres, in scene units; unset: by `distances`. Given, it is a hard limit.
    pub max_distance: Option<f64>,
    /// Candidates that are kept, nearest first.
    pub neighbours: u32,
    /// How many of these are read: M, 1 to 8.
    pub used: u32,
    /// Which ones training reads.
    pub draw: Draw,
    /// How many are used at a pixel: the first that see its point; V, 1 to 4.
    pub visible: u32,
    /// A source sees a point when its own depth there differs by less than this share.
    pub depth_agreement: f64,
    /// Memory for the photos on the GPU: `auto`, `none` (no limit), or a size such as `512MiB`.
    pub memory: MemoryBudget,
}

impl Default for SourceOptions {
    fn default() -> Self {
        Self {
            max_angle_deg: 30.0,
            distances: Distances::Adaptive,
            min_distance: None,
            max_distance: None,
            neighbours: 8,
            used: 4,
            draw: Draw::Random,
            visible: 3,
            depth_agreement: 0.01,
            memory: MemoryBudget::Auto,
        }
    }
}

/// Chooses the sources of any view among the training cameras.
#[derive(Clone, Debug)]
pub struct SourceFinder {
    cameras: Vec<Camera>,
    max_angle: f64,
    /// Least and most distance, both included.
    distances: [f64; 2],
    /// Views with fewer candidates take more beyond the most distance; 0: never.
    fill: usize,
    kept: usize,
    used: usize,
}

/// A training view as a candidate: distance, angle between the optical axes, index.
type Candidate = (f64, f64, usize);

impl SourceFinder {
    /// Settles the thresholds for a scene's training cameras.
    pub fn new(cameras: &[Camera], options: &SourceOptions) -> Self {
        let mut finder = Self {
            cameras: cameras.to_vec(),
            max_angle: options.max_angle_deg.to_radians(),
            distances: [0.0, f64::INFINITY],
            fill: 0,
            kept: options.neighbours as usize,
            used: options.used as usize,
        };
        let usual = match options.distances {
            Distances::Absolute => PUBLISHED_DISTANCES,
            Distances::Adaptive => finder.adaptive(options),
        };
        finder.distances = [options.min_distance.unwrap_or(usual[0]), options.max_distance.unwrap_or(usual[1])];
        if options.distances == Distances::Adaptive && options.max_distance.is_none() {
            finder.fill = options.used as usize;
        }
        finder
    }

    /// Least and most distance of a source in scene units.
    pub fn distances(&self) -> [f64; 2] {
        self.distances
    }

    fn adaptive(&self, options: &SourceOptions) -> [f64; 2] {
        let centers: Vec<DVec3> = self.cameras.iter().map(Camera::center).collect();
        let nearest = |(i, a): (usize, &DVec3)| {
            let others = centers.iter().enumerate().filter(move |(j, _)| *j != i);
            others.map(|(_, b)| a.distance(*b)).min_by(f64::total_cmp)
        };
        let least = options.min_distance.unwrap_or_else(|| {
            let spacing = median(centers.iter().enumerate().filter_map(nearest).collect());
            LEAST * spacing.unwrap_or(0.0)
        });
        let last_kept = |(i, camera): (usize, &Camera)| {
            let found = self.by_distance(camera, Some(i), least);
            found.get(self.kept.max(1) - 1).or(found.last()).map(|candidate| candidate.0)
        };
        let reach = median(self.cameras.iter().enumerate().filter_map(last_kept).collect());
        [least, reach.map_or(f64::INFINITY, |reach| REACH * reach)]
    }

    /// Training views within the angle and not nearer than `least`: by distance, then by angle, then by index.
    fn by_distance(&self, target: &Camera, exclude: Option<usize>, least: f64) -> Vec<Candidate> {
        let (center, forward) = (target.center(), target.forward());
        let others = self.cameras.iter().enumerate().filter(|(index, _)| Some(*index) != exclude);
        let mut found: Vec<Candidate> = others
            .map(|(index, camera)| {
                // Rounding takes the cosine of equal axes over 1, whose arc cosine is NaN.
                let angle = forward.dot(camera.forward()).clamp(-1.0, 1.0).acos();
                (camera.center().distance(center), angle, index)
            })
            .filter(|&(distance, angle, _)| angle < self.max_angle && distance >= least)
            .collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
        found
    }

    /// The sources of `target`, best first: indices of training cameras, at most [`SourceOptions::neighbours`].
    /// `exclude` is the target's own index where it is a training view.
    pub fn neighbours(&self, target: &Camera, exclude: Option<usize>) -> Vec<usize> {
        let [least, most] = self.distances;
        let found = self.by_distance(target, exclude, least);
        let near = found.iter().take_while(|candidate| candidate.0 <= most).count();
        found.iter().take(near.max(self.fill)).map(|candidate| candidate.2).take(self.kept).collect()
    }

    /// Those of [`SourceFinder::neighbours`] that are read for the target: the first [`SourceOptions::used`].
    pub fn sources(&self, target: &Camera, exclude: Option<usize>) -> Vec<usize> {
        let mut chosen = self.neighbours(target, exclude);
        chosen.truncate(self.used);
        chosen
    }
}

/// The sources of one target; for many targets of a scene make one [`SourceFinder`].
pub fn neighbours(target: &Camera, exclude: Option<usize>, cameras: &[Camera], options: &SourceOptions) -> Vec<usize> {
    SourceFinder::new(cameras, options).neighbours(target, exclude)
}

/// The middle value, the lower one of two; none without any.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied()
}
