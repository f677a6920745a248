//! Levels of detail: a model as a tree of chunks, of which a view needs a part. The leaves hold the model's own Gaussians, every
//! other chunk stands for its two children with about half as many, of which neighbours are merged (after Kerbl et al., "A
//! Hierarchical 3D Gaussian Representation", 2024). A file may be larger than the host's memory once it is written, and the model
//! larger than the device's.

mod build;
mod cut;
mod file;
mod stream;
mod streamed;

pub use build::{CHUNK, build};
pub use file::{Levels, Tree, write};
pub use stream::{Loading, Stream, slots};
pub use streamed::write_streamed;

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A chunk, in local coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Node {
    /// The box of the means.
    pub low: Vec3,
    /// Its other corner.
    pub high: Vec3,
    /// Three standard deviations of its largest Gaussian.
    pub reach: f32,
    /// Largest standard deviation of a Gaussian that stands for several; 0 in a leaf. What is smaller than a pixel hides the
    /// difference.
    pub error: f32,
    /// Gaussians.
    pub count: u32,
    /// The two that it stands for; none of a leaf.
    pub children: Option<[u32; 2]>,
}
