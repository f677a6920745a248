//! One-file bundle `.ibgs`: everything that rendering a model from new places needs, in one ZIP archive.
//!
//! ```text
//! ibgs.json         {"format": 1, "iteration": N}
//! exposure.json     the training photos' exposures, as in the output folder; absent where they were not corrected
//! cameras.json  multi_view.json  config.toml     as in the output folder
//! point_cloud.ply   the Gaussians with planes
//! network.bin       the residual network, as its own module wrote it; absent without one
//! photos/NAME.png   the training views' photos as they were trained on: undistorted, resized, 8 bits, lossless
//! ```
//!
//! A small bundle ([`Packing::Small`], format 2) has the Gaussians as `gaussians.sog` and `planes.bin` in place of
//! `point_cloud.ply`, with the scene's offset in `ibgs.json`, and opaque photos as `photos/NAME.jpg`.
//!
//! A bundle with levels of detail ([`Packing::Levels`], format 3) has `levels.json` and `levels.bin` in place of
//! `point_cloud.ply`: the tree of its chunks and their numbers, which stay in the file until they are needed.
//!
//! A bundle of an ensemble (format 4) has the Gaussians, exposures and network of each further member in `member_2/`, `member_3/`
//! and so on, after the network.
//!
//! The order lets a browser show the base image early: with the constant colours as soon as the SOG file has come to its
//! spherical harmonics, see [`Bundle::read_start`].
//!
//! Nothing is compressed a second time: photos are compressed already, and numbers barely shrink. So no part can be larger
//! than the file. The archive's own checksums show damage.

mod error;
mod photos;
mod read;
mod write;

pub use error::BundleError;

use crate::config::TrainConfig;
use crate::dataset::HostPhoto;
use crate::ensemble::{self, Member};
use crate::exposure::Exposure;
use crate::levels::Levels;
use crate::local_space::LocalSpace;
use crate::output::cameras::CameraRecord;
use crate::output::multi_view::ViewSources;
use crate::scene::Gaussians;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::sync::Arc;

/// Version of the layout, and of that of small bundles.
const FORMAT: u32 = 1;
const SMALL_FORMAT: u32 = 2;
/// That of bundles with levels of detail.
const LEVELS_FORMAT: u32 = 3;
/// That of bundles of an ensemble, the latest.
const ENSEMBLE_FORMAT: u32 = 4;

/// Everything that rendering a model needs.
#[derive(Clone, Debug)]
pub struct Bundle {
    /// Iteration that the model was saved at.
    pub iteration: u32,
    /// The Gaussians; where there are levels of detail, the coarsest.
    pub gaussians: Gaussians,
    /// The further members of an ensemble.
    pub members: Vec<Member>,
    /// The levels of detail of a bundle that was read with them.
    pub levels: Option<Arc<Levels>>,
    /// The residual network in its module's own form; none without.
    pub network: Option<Vec<u8>>,
    /// The training photos' exposures by name; none where they were not corrected.
    pub exposure: Option<HashMap<String, Exposure>>,
    /// All views' cameras.
    pub cameras: Vec<CameraRecord>,
    /// How it was trained.
    pub config: TrainConfig,
    /// Photos of the training views by name: one for every training camera, of its size.
    pub photos: Vec<(String, HostPhoto)>,
    /// The sources of each view.
    pub sources: Vec<ViewSources>,
}

/// How Gaussians and photos are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Packing {
    /// Every value as it is.
    #[default]
    Lossless,
    /// Gaussians in the steps of a SOG file, opaque photos as JPEG.
    Small {
        /// JPEG's quality, 1 to 100.
        photo_quality: u8,
    },
    /// Photos without loss, Gaussians with levels of detail, in the coordinates in which they are rendered; of an ensemble the first
    /// member alone.
    Levels,
}

#[derive(Serialize, Deserialize)]
struct Header {
    format: u32,
    iteration: u32,
    /// Of a small bundle: where the coordinates of its Gaussians lie in the scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    offset: Option<DVec3>,
}

impl Header {
    /// Where a small bundle's Gaussians are.
    fn space(&self) -> LocalSpace {
        LocalSpace::at(self.offset.unwrap_or_default())
    }
}

/// The Gaussians' part, and that of a small bundle.
const CLOUD: &str = "point_cloud.ply";
const SOG: &str = "gaussians.sog";
/// The parts of levels of detail.
const TREE: &str = "levels.json";
const CHUNKS: &str = "levels.bin";
/// The part that says what the bundle is, and the options' part.
const HEADER: &str = "ibgs.json";
const OPTIONS: &str = "config.toml";

/// The planes' part of a small bundle.
const PLANES: &str = "planes.bin";
/// The residual network's part.
const NETWORK: &str = "network.bin";

/// A part of a member of an ensemble, counted from 1.
fn member_part(number: usize, part: &str) -> String {
    if number == 1 { part.to_owned() } else { format!("{}/{part}", ensemble::folder(number)) }
}
