//! `results_renders.json`, `per_view_renders.json` and their like for the final image: scores with the protocol that they were taken by.

use crate::score::Score;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

/// Scores of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewScore {
    /// Image name.
    pub name: String,
    /// Peak signal to noise ratio in dB of the images clamped to 8 bits (method.md section 9).
    pub psnr: f64,
    /// The same after an affine map of the colours.
    pub aligned_psnr: f64,
    /// Structural similarity, 11 x 11 Gaussian window (method.md section 7).
    pub ssim: f64,
    /// LPIPS (method.md section 9), where it was computed.
    pub lpips: Option<f64>,
}

/// Which image was scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scored {
    /// The base image.
    Base,
    /// The final image: base and residual.
    Final,
}

impl Scored {
    /// The files of the means and of the single views.
    pub(super) fn files(self) -> [&'static str; 2] {
        match self {
            Self::Base => ["results_renders.json", "per_view_renders.json"],
            Self::Final => ["results_renders_aggregate.json", "per_view_renders_aggregate.json"],
        }
    }
}

/// What a figure depends on besides the method; it stands beside every figure.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Protocol {
    /// Filter that made the photos smaller, or `none`.
    pub resampler: String,
    /// Factor or width of the photos, as the option `data.resolution` takes it.
    pub factor: String,
    /// Which views were held out, for instance `every 8th`.
    pub split: String,
    /// `true` or `centred`.
    pub principal_point: String,
    /// How masked photos were compared: `ignore` where masked pixels do not count.
    pub masks: String,
    /// Name of the adapter.
    pub device: String,
    /// Network of LPIPS and range of its images, where it was computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lpips: Option<String>,
}

/// Results of before there was a choice.
/// Mean scores over the views; NaN without any. LPIPS where every view has it.
pub fn means(scores: &[ViewScore]) -> Score {
    let mean = |value: fn(&ViewScore) -> f64| scores.iter().map(value).sum::<f64>() / scores.len() as f64;
    let lpips: Option<f64> = scores.iter().map(|score| score.lpips).sum();
    let lpips = lpips.map(|sum| sum / scores.len() as f64);
    let (psnr, aligned_psnr) = (mean(|score| score.psnr), mean(|score| score.aligned_psnr));
    Score { psnr, aligned_psnr, ssim: mean(|score| score.ssim), lpips }
}

/// Means over the views and the protocol.
pub(super) fn summary(scores: &[ViewScore], protocol: &Protocol) -> Value {
    let mean = means(scores);
    json!({
        "SSIM": mean.ssim,
        "PSNR": mean.psnr,
        "PSNR_aligned": mean.aligned_psnr,
        "LPIPS": mean.lpips,
        "views": scores.len(),
        "protocol": protocol,
    })
}

/// Every view's scores by name.
pub(super) fn per_view(scores: &[ViewScore]) -> Value {
    let by_name = |value: fn(&ViewScore) -> Value| -> Map<String, Value> {
        scores.iter().map(|score| (score.name.clone(), value(score))).collect()
    };
    json!({
        "SSIM": by_name(|score| json!(score.ssim)),
        "PSNR": by_name(|score| json!(score.psnr)),
        "PSNR_aligned": by_name(|score| json!(score.aligned_psnr)),
        "LPIPS": by_name(|score| json!(score.lpips)),
    })
}
