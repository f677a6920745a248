//! The columns in which models are compared.

use ibgs_core::output::figures::{Figures, Means};
use ibgs_core::progress::duration;

/// One figure of a model.
pub struct Column {
    /// Title in tables.
    pub title: &'static str,
    /// Name in JSON.
    pub key: &'static str,
    /// Whether larger is better.
    pub more_is_better: bool,
    /// Reads the value from a model's figures.
    pub value: fn(&Figures) -> Option<f64>,
    /// Formats the value.
    pub text: fn(f64) -> String,
}

fn image(figures: &Figures, value: fn(&Means) -> Option<f64>) -> Option<f64> {
    figures.image.as_ref().and_then(|scores| value(&scores.means))
}

fn base(figures: &Figures, value: fn(&Means) -> Option<f64>) -> Option<f64> {
    figures.base.as_ref().and_then(|scores| value(&scores.means))
}

fn decibels(value: f64) -> String {
    format!("{value:.3}")
}

fn ratio(value: f64) -> String {
    format!("{value:.4}")
}

fn rate(value: f64) -> String {
    format!("{value:.1}")
}

/// Scores first, then costs.
pub const COLUMNS: [Column; 11] = [
    Column {
        title: "final PSNR",
        key: "final_PSNR",
        more_is_better: true,
        value: |f| image(f, |m| m.psnr),
        text: decibels,
    },
    Column { title: "SSIM", key: "final_SSIM", more_is_better: true, value: |f| image(f, |m| m.ssim), text: ratio },
    Column { title: "LPIPS", key: "final_LPIPS", more_is_better: false, value: |f| image(f, |m| m.lpips), text: ratio },
    Column {
        title: "base PSNR",
        key: "base_PSNR",
        more_is_better: true,
        value: |f| base(f, |m| m.psnr),
        text: decibels,
    },
    Column { title: "SSIM", key: "base_SSIM", more_is_better: true, value: |f| base(f, |m| m.ssim), text: ratio },
    Column { title: "LPIPS", key: "base_LPIPS", more_is_better: false, value: |f| base(f, |m| m.lpips), text: ratio },
    Column {
        title: "Gaussians",
        key: "gaussians",
        more_is_better: false,
        value: |f| f.speed.as_ref()?.gaussians.map(|count| count as f64),
        text: |count| format!("{count:.0}"),
    },
    Column {
        title: "training",
        key: "training_seconds",
        more_is_better: false,
        value: |f| f.time.as_ref()?.seconds,
        text: duration,
    },
    Column {
        title: "FPS warm",
        key: "FPS_warm",
        more_is_better: true,
        value: |f| f.speed.as_ref()?.fps_warm,
        text: rate,
    },
    Column {
        title: "FPS cold",
        key: "FPS_cold",
        more_is_better: true,
        value: |f| f.speed.as_ref()?.fps_cold,
        text: rate,
    },
    Column {
        title: "storage MB",
        key: "storage_bytes",
        more_is_better: false,
        value: |f| f.speed.as_ref()?.storage_bytes.total().map(|bytes| bytes as f64),
        text: |bytes| format!("{:.2}", bytes * 1e-6),
    },
];
