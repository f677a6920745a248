//! Exposure of photos: what a camera with automatic exposure and white balance changes from photo to photo.
//!
//! The model has the mean exposure of the photos. Each photo shows it in its own exposure, `exp(g) color + o` for each
//! channel. The six numbers of every training photo are learned with the Gaussians, with a weak pull towards 0.
//! Everything that is compared with a photo is converted to the photo's exposure first: the base image, for all of its
//! loss, and the colours of the sources, from their own exposures. So the residual network never sees a difference in
//! exposure alone. The exposure of a view without a photo is predicted from those of the photos around it
//! ([`ExposureField`]).
//!
//! A departure from method.md section 8, where one gain and one offset count in the L1 part of the base's loss alone, the final
//! image takes a least-squares fit to its first source, and nothing corrects the base of a held-out view: on a capture with
//! automatic exposure that lost 0.8 dB.

mod field;
mod operation;
mod photos;

pub use field::{ExposureField, FILE_NAME, from_json, to_json};
pub use operation::{Exposer, Exposures};
pub use photos::{ExposureAdam, ExposureState, PhotoExposures};

use serde::{Deserialize, Serialize};

/// An exposure: `exp(log_gain) color + offset`, by channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Exposure {
    /// Logarithms of the gains of red, green and blue.
    pub log_gain: [f32; 3],
    /// What is added to them, 1 is white.
    pub offset: [f32; 3],
}

impl Exposure {
    /// Whether all its numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.log_gain.iter().chain(&self.offset).all(|v| v.is_finite())
    }

    /// As a row on the device: (log gains, 0), (offsets, 0).
    fn row(&self) -> [f32; ROW] {
        let ([a, b, c], [d, e, f]) = (self.log_gain, self.offset);
        [a, b, c, 0.0, d, e, f, 0.0]
    }

    fn from_row(row: &[f32]) -> Self {
        Self { log_gain: [row[0], row[1], row[2]], offset: [row[4], row[5], row[6]] }
    }
}

/// Floats of an exposure on the device.
const ROW: usize = 8;
/// Bytes of the same.
const ROW_BYTES: u64 = 4 * ROW as u64;
