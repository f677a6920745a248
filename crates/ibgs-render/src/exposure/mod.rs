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
pub use operation::{ExposurePass, Exposures};
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

    /// As rows on the device: (log gains, 0), (offsets, 0).
    fn rows(&self) -> [[f32; 4]; ROWS] {
        let ([a, b, c], [d, e, f]) = (self.log_gain, self.offset);
        [[a, b, c, 0.0], [d, e, f, 0.0]]
    }

    fn from_rows(rows: &[[f32; 4]]) -> Self {
        let [[a, b, c, _], [d, e, f, _]] = [rows[0], rows[1]];
        Self { log_gain: [a, b, c], offset: [d, e, f] }
    }
}

/// Rows of an exposure on the device, of four floats each.
const ROWS: usize = 2;
