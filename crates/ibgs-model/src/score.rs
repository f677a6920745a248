//! The scores of one image, which evaluations make and model folders keep.

use serde::{Deserialize, Deserializer, Serialize};

/// PSNR, SSIM and LPIPS of an image rounded to 8 bits against a photo.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Peak signal-to-noise ratio in dB, over the valid pixels; infinite for equal images.
    #[serde(deserialize_with = "or_infinite")]
    pub psnr: f64,
    /// The same after the affine map of the image's colours that brings it nearest to the photo, for photos whose exposure
    /// cannot be predicted from their neighbours.
    #[serde(deserialize_with = "or_infinite")]
    pub aligned_psnr: f64,
    /// Mean SSIM over the valid pixels and channels, 11 x 11 Gaussian window, zero padding; 1 without a valid pixel.
    pub ssim: f64,
    /// LPIPS, 0 for equal images; none where it was not computed.
    pub lpips: Option<f64>,
}

/// JSON has no infinity, so null stands for it.
fn or_infinite<'de, D: Deserializer<'de>>(value: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(value)?.unwrap_or(f64::INFINITY))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_infinite_score_survives_json() {
        let score = Score { psnr: f64::INFINITY, aligned_psnr: 30.5, ssim: 1.0, lpips: None };
        let text = serde_json::to_string(&score).unwrap();
        assert_eq!(serde_json::from_str::<Score>(&text).unwrap(), score);
    }
}
