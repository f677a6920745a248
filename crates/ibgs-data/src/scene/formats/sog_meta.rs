//! The `meta.json` of SOG files, see [`super::sog`]: what the pictures hold and how their bytes become numbers.

use super::super::gaussians::coefficients;
use super::sog::{ANTIALIASED, MOST_SIDE};
use super::{MAX_SH_DEGREE, quantise};
use serde::Deserialize;

/// Gaussians for each byte of a file. Real ones have ten bytes and more each.
const MOST_COUNT_A_BYTE: u64 = 8;

/// What all pictures hold, in any version.
pub(super) struct Layout {
    pub(super) count: usize,
    pub(super) means: Means,
    /// The picture of the quaternions.
    pub(super) rotations: String,
    pub(super) scales: Coded,
    pub(super) colors: Coded,
    /// Logits of the 256 values of alpha in the picture of the colours.
    pub(super) opacities: Vec<f32>,
    pub(super) harmonics: Option<Harmonics>,
    pub(super) antialiased: bool,
}

#[derive(Deserialize)]
pub(super) struct Means {
    pub(super) mins: [f64; 3],
    pub(super) maxs: [f64; 3],
    /// The low bytes, then the high ones.
    pub(super) files: [String; 2],
}

/// A picture, and what the bytes of its red, green and blue stand for.
pub(super) struct Coded {
    pub(super) codes: [Vec<f32>; 3],
    pub(super) file: String,
}

/// A palette of higher coefficients.
pub(super) struct Harmonics {
    /// Entries, and coefficients a channel; version 1 leaves both to the size of its picture.
    pub(super) size: Option<[usize; 2]>,
    pub(super) codes: Vec<f32>,
    pub(super) palette: String,
    /// The picture with the entry of each Gaussian.
    pub(super) labels: String,
}

#[derive(Deserialize)]
struct Version {
    version: Option<u32>,
}

#[derive(Deserialize)]
struct Meta2 {
    count: usize,
    means: Means,
    scales: Codebook,
    quats: Plain,
    sh0: Codebook,
    #[serde(rename = "shN")]
    harmonics: Option<Harmonics2>,
    model: Option<String>,
}

#[derive(Deserialize)]
struct Codebook {
    /// JavaScript writes numbers that are not finite as null.
    codebook: Vec<Option<f32>>,
    files: [String; 1],
}

impl Codebook {
    /// With `null` for the numbers that JSON cannot hold.
    fn coded(self, null: f32) -> Coded {
        let codes: Vec<f32> = self.codebook.into_iter().map(|value| value.unwrap_or(null)).collect();
        let [file] = self.files;
        Coded { codes: [codes.clone(), codes.clone(), codes], file }
    }
}

#[derive(Deserialize)]
struct Plain {
    files: [String; 1],
}

#[derive(Deserialize)]
struct Harmonics2 {
    count: usize,
    bands: u32,
    codebook: Vec<f32>,
    files: [String; 2],
}

#[derive(Deserialize)]
struct Meta1 {
    means: Means1,
    scales: Steps<[f64; 3]>,
    quats: Plain,
    sh0: Steps<[f64; 4]>,
    #[serde(rename = "shN")]
    harmonics: Option<Harmonics1>,
}

#[derive(Deserialize)]
struct Means1 {
    shape: Vec<usize>,
    #[serde(flatten)]
    means: Means,
}

/// Even steps between bounds, for each channel of a picture.
#[derive(Deserialize)]
struct Steps<T> {
    mins: T,
    maxs: T,
    files: [String; 1],
}

#[derive(Deserialize)]
struct Harmonics1 {
    mins: f64,
    maxs: f64,
    files: [String; 2],
}

/// What a byte stands for: 256 even steps from `low` to `high`.
fn even(low: f64, high: f64) -> Vec<f32> {
    (0..=255).map(|step| (low + (high - low) * f64::from(step) / 255.0) as f32).collect()
}

impl Layout {
    /// Of the text of a `meta.json`, whose pictures are `length` bytes together.
    ///
    /// # Errors
    /// What is wrong.
    pub(super) fn parse(text: &[u8], length: impl FnOnce(&Self) -> Result<u64, String>) -> Result<Self, String> {
        let wrong = |error: serde_json::Error| format!("its `meta.json` is wrong: {error}");
        let layout = match serde_json::from_slice::<Version>(text).map_err(wrong)?.version {
            None | Some(1) => Self::of_version_1(serde_json::from_slice(text).map_err(wrong)?)?,
            Some(2) => Self::of_version_2(serde_json::from_slice(text).map_err(wrong)?)?,
            Some(version) => return Err(format!("it has version {version} of the format; versions 1 and 2 are read")),
        };
        let length = length(&layout)?;
        if layout.count as u64 > length.saturating_mul(MOST_COUNT_A_BYTE) || layout.count > MOST_SIDE * MOST_SIDE {
            return Err(format!("it promises {} Gaussians, more than its {length} bytes can hold", layout.count));
        }
        Ok(layout)
    }

    fn of_version_2(meta: Meta2) -> Result<Self, String> {
        let harmonics = meta.harmonics.filter(|harmonics| harmonics.bands > 0);
        let harmonics = harmonics.map(|Harmonics2 { count, bands, codebook, files: [palette, labels] }| {
            if bands > MAX_SH_DEGREE {
                return Err(format!(
                    "its spherical harmonics have degree {bands}; degrees 0 to {MAX_SH_DEGREE} are read"
                ));
            }
            Ok(Harmonics { size: Some([count, coefficients(bands) - 1]), codes: codebook, palette, labels })
        });
        let [rotations] = meta.quats.files;
        Ok(Self {
            count: meta.count,
            means: meta.means,
            rotations,
            // The logarithm of 0.
            scales: meta.scales.coded(f32::NEG_INFINITY),
            colors: meta.sh0.coded(f32::NAN),
            opacities: (0..=255).map(quantise::logit_of_byte).collect(),
            harmonics: harmonics.transpose()?,
            antialiased: meta.model.as_deref() == Some(ANTIALIASED),
        })
    }

    fn of_version_1(meta: Meta1) -> Result<Self, String> {
        let Some(&count) = meta.means.shape.first() else {
            return Err("the `shape` of its `means` is empty".to_owned());
        };
        let codes = |mins: &[f64], maxs: &[f64]| [0, 1, 2].map(|channel| even(mins[channel], maxs[channel]));
        let ([rotations], [scales], [colors]) = (meta.quats.files, meta.scales.files, meta.sh0.files);
        let [.., low] = meta.sh0.mins;
        let [.., high] = meta.sh0.maxs;
        let harmonics = meta.harmonics.map(|Harmonics1 { mins, maxs, files: [palette, labels] }| Harmonics {
            size: None,
            codes: even(mins, maxs),
            palette,
            labels,
        });
        Ok(Self {
            count,
            means: meta.means.means,
            rotations,
            scales: Coded { codes: codes(&meta.scales.mins, &meta.scales.maxs), file: scales },
            colors: Coded { codes: codes(&meta.sh0.mins, &meta.sh0.maxs), file: colors },
            opacities: even(low, high),
            harmonics,
            antialiased: false,
        })
    }

    /// The names of all pictures.
    pub(super) fn files(&self) -> impl Iterator<Item = &str> {
        let harmonics = self.harmonics.iter().flat_map(|harmonics| [&harmonics.palette, &harmonics.labels]);
        let others = [&self.rotations, &self.scales.file, &self.colors.file];
        self.means.files.iter().chain(others).chain(harmonics).map(String::as_str)
    }
}
