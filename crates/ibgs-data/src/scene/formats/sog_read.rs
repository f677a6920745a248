//! Reading of SOG files, see [`super::sog`].

use super::super::Gaussians;
use super::super::gaussians::coefficients;
use super::sog::{ENTRIES_A_ROW, FIRST_LARGEST, MOST_POSITION, MOST_SIDE, from_log};
use super::{MAX_SH_DEGREE, quantise};
use image_webp::WebPDecoder;
use serde::Deserialize;
use std::f64::consts::SQRT_2;
use std::io::{Cursor, Read};
use zip::ZipArchive;

/// Gaussians for each byte of a file. Real ones have ten bytes and more each.
const MOST_COUNT_A_BYTE: usize = 8;
/// Largest `meta.json`.
const MOST_META: u64 = 1 << 20;

#[derive(Deserialize)]
struct Meta {
    count: usize,
    means: Means,
    scales: Coded,
    quats: Plain,
    sh0: Coded,
    #[serde(rename = "shN")]
    harmonics: Option<Harmonics>,
}

#[derive(Deserialize)]
struct Means {
    mins: [f64; 3],
    maxs: [f64; 3],
    files: [String; 2],
}

#[derive(Deserialize)]
struct Coded {
    /// JavaScript writes numbers that are not finite as null.
    codebook: Vec<Option<f32>>,
    files: [String; 1],
}

impl Coded {
    /// The codebook with a number for those that JSON cannot hold.
    fn codebook(&self, null: f32) -> Vec<f32> {
        self.codebook.iter().map(|value| value.unwrap_or(null)).collect()
    }
}

#[derive(Deserialize)]
struct Plain {
    files: [String; 1],
}

#[derive(Deserialize)]
struct Harmonics {
    count: usize,
    bands: u32,
    codebook: Vec<f32>,
    files: [String; 2],
}

/// Only the version, which says what the rest is.
#[derive(Deserialize)]
struct Version {
    version: Option<u32>,
}

/// Reads a whole file.
///
/// # Errors
/// What is wrong.
pub(super) fn read(bytes: &[u8]) -> Result<Gaussians, String> {
    let (mut archive, meta) = open(bytes)?;
    gaussians(&mut archive, &meta)
}

/// Reads a file as if its spherical harmonics had degree 0; it may lack the pictures of the others.
///
/// # Errors
/// What is wrong.
pub(super) fn read_base(bytes: &[u8]) -> Result<Gaussians, String> {
    let (mut archive, meta) = open(bytes)?;
    gaussians(&mut archive, &Meta { harmonics: None, ..meta })
}

/// The pictures and what they mean.
fn open(bytes: &[u8]) -> Result<(Archive<'_>, Meta), String> {
    let zip = ZipArchive::new(Cursor::new(bytes)).map_err(|error| format!("it is no whole ZIP archive ({error})"))?;
    // Pictures do not compress, so an archive holds hardly more than its own length.
    let mut archive = Archive { zip, left: 2 * bytes.len() as u64 + MOST_META };
    let text = archive.bytes("meta.json")?;
    let version = serde_json::from_slice::<Version>(&text).ok().and_then(|meta| meta.version).unwrap_or(1);
    if version != 2 {
        return Err(format!("it has version {version} of the format; version 2 is read"));
    }
    let meta: Meta = serde_json::from_slice(&text).map_err(|error| format!("its `meta.json` is wrong: {error}"))?;
    if meta.count > bytes.len().saturating_mul(MOST_COUNT_A_BYTE) || meta.count > MOST_SIDE * MOST_SIDE {
        return Err(format!("it promises {} Gaussians, more than its {} bytes can hold", meta.count, bytes.len()));
    }
    Ok((archive, meta))
}

fn gaussians(archive: &mut Archive, meta: &Meta) -> Result<Gaussians, String> {
    let degree = meta.harmonics.as_ref().map_or(0, |harmonics| harmonics.bands);
    if degree > MAX_SH_DEGREE {
        return Err(format!("its spherical harmonics have degree {degree}; degrees 0 to {MAX_SH_DEGREE} are read"));
    }
    let mut g = Gaussians::with_capacity(meta.count, degree);
    means(archive, meta, &mut g)?;
    rotations(archive, meta, &mut g)?;
    scales(archive, meta, &mut g)?;
    colors(archive, meta, &mut g)?;
    Ok(g)
}

fn means(archive: &mut Archive, meta: &Meta, g: &mut Gaussians) -> Result<(), String> {
    let Means { mins, maxs, files } = &meta.means;
    let low = archive.plane(&files[0], meta.count)?;
    let high = archive.plane(&files[1], meta.count)?;
    g.means.extend(low.iter().zip(high).take(meta.count).map(|(low, high)| {
        [0, 1, 2].map(|axis| {
            let part = f64::from(u16::from_le_bytes([low[axis], high[axis]])) / f64::from(MOST_POSITION);
            from_log(mins[axis] + (maxs[axis] - mins[axis]) * part) as f32
        })
    }));
    Ok(())
}

fn rotations(archive: &mut Archive, meta: &Meta, g: &mut Gaussians) -> Result<(), String> {
    let plane = archive.plane(&meta.quats.files[0], meta.count)?;
    g.rotations.extend(plane[..meta.count].iter().map(|&[a, b, c, tag]| {
        let others = [a, b, c].map(|v| (f64::from(v) / 255.0 * 2.0 - 1.0) / SQRT_2);
        match tag.checked_sub(FIRST_LARGEST) {
            Some(largest) => quantise::from_smallest_three(largest.into(), others),
            None => [1.0, 0.0, 0.0, 0.0],
        }
    }));
    Ok(())
}

fn scales(archive: &mut Archive, meta: &Meta, g: &mut Gaussians) -> Result<(), String> {
    // The logarithm of 0.
    let codebook = &meta.scales.codebook(f32::NEG_INFINITY);
    let plane = archive.plane(&meta.scales.files[0], meta.count)?;
    for &[x, y, z, _] in &plane[..meta.count] {
        g.log_scales.push([code(codebook, x, "scales")?, code(codebook, y, "scales")?, code(codebook, z, "scales")?]);
    }
    Ok(())
}

/// Colours of every degree, and opacities.
fn colors(archive: &mut Archive, meta: &Meta, g: &mut Gaussians) -> Result<(), String> {
    let codebook = &meta.sh0.codebook(f32::NAN);
    let plane = archive.plane(&meta.sh0.files[0], meta.count)?;
    let higher = meta.harmonics.as_ref().filter(|harmonics| harmonics.bands > 0);
    let mut higher = higher.map(|harmonics| Higher::open(archive, harmonics, meta.count)).transpose()?;
    for (index, &[red, green, blue, opacity]) in plane[..meta.count].iter().enumerate() {
        g.opacity_logits.push(quantise::logit_of_byte(opacity));
        for channel in [red, green, blue] {
            g.sh.push(code(codebook, channel, "sh0")?);
        }
        if let Some(higher) = &mut higher {
            higher.append(index, &mut g.sh)?;
        }
    }
    Ok(())
}

/// The palette of the higher coefficients, and the place of every Gaussian in it.
struct Higher<'a> {
    harmonics: &'a Harmonics,
    labels: Vec<[u8; 4]>,
    /// As the picture has it: rows of 64 entries.
    entries: Vec<[u8; 4]>,
    /// Coefficients a channel.
    width: usize,
}

impl<'a> Higher<'a> {
    fn open(archive: &mut Archive, harmonics: &'a Harmonics, count: usize) -> Result<Self, String> {
        let [centroids, labels] = &harmonics.files;
        let width = coefficients(harmonics.bands) - 1;
        let picture = archive.picture(centroids, usize::from(u16::MAX) + 1)?;
        let is_whole = picture.width == ENTRIES_A_ROW * width
            && picture.pixels.len() / picture.width >= harmonics.count.div_ceil(ENTRIES_A_ROW);
        if !is_whole {
            return Err(format!("its `{centroids}` is no palette of {} entries", harmonics.count));
        }
        Ok(Self { harmonics, labels: archive.plane(labels, count)?, entries: picture.pixels, width })
    }

    fn append(&self, index: usize, sh: &mut Vec<f32>) -> Result<(), String> {
        let label = usize::from(u16::from_le_bytes([self.labels[index][0], self.labels[index][1]]));
        if label >= self.harmonics.count {
            return Err(format!("Gaussian {index} has the entry {label} of a palette of {}", self.harmonics.count));
        }
        // 64 entries fill a row of the picture, so they follow one another.
        for &[red, green, blue, _] in &self.entries[self.width * label..self.width * (label + 1)] {
            for channel in [red, green, blue] {
                sh.push(code(&self.harmonics.codebook, channel, "shN")?);
            }
        }
        Ok(())
    }
}

fn code(codebook: &[f32], at: u8, field: &str) -> Result<f32, String> {
    let missing = || format!("the codebook of its `{field}` has {} entries, not the entry {at}", codebook.len());
    codebook.get(usize::from(at)).copied().ok_or_else(missing)
}

struct Picture {
    width: usize,
    pixels: Vec<[u8; 4]>,
}

/// The archive, and how many bytes may still be unpacked.
struct Archive<'a> {
    zip: ZipArchive<Cursor<&'a [u8]>>,
    left: u64,
}

impl Archive<'_> {
    fn bytes(&mut self, name: &str) -> Result<Vec<u8>, String> {
        let most = if name == "meta.json" { MOST_META } else { self.left };
        let entry = self.zip.by_name(name).map_err(|error| format!("its `{name}` cannot be read ({error})"))?;
        let mut bytes = Vec::new();
        entry
            .take(most + 1)
            .read_to_end(&mut bytes)
            .map_err(|error| format!("its `{name}` cannot be read ({error})"))?;
        if bytes.len() as u64 > most {
            return Err(format!("its `{name}` unpacks to more than {most} bytes"));
        }
        self.left -= (bytes.len() as u64).min(self.left);
        Ok(bytes)
    }

    /// A picture of at least `count` pixels and not many more.
    fn plane(&mut self, name: &str, count: usize) -> Result<Vec<[u8; 4]>, String> {
        let pixels = self.picture(name, count)?.pixels;
        if pixels.len() < count {
            return Err(format!("its `{name}` has {} pixels where {count} are needed", pixels.len()));
        }
        Ok(pixels)
    }

    /// A picture for `count` values; its size is checked before it is unpacked.
    fn picture(&mut self, name: &str, count: usize) -> Result<Picture, String> {
        let wrong = |error: &dyn std::fmt::Display| format!("its `{name}` is no lossless WebP picture ({error})");
        let bytes = self.bytes(name)?;
        let mut decoder = WebPDecoder::new(Cursor::new(bytes.as_slice())).map_err(|error| wrong(&error))?;
        let (width, height) = decoder.dimensions();
        let size = u64::from(width) * u64::from(height);
        // Sides are rounded up to whole blocks of pixels; a palette has 64 entries of up to 15 pixels a row.
        let most = 16 * count as u64 + 16 * u64::from(width.max(64));
        if size > most {
            return Err(format!("its `{name}` has {width} x {height} pixels, far more than its {count} values need"));
        }
        let (channels, pixels) = (if decoder.has_alpha() { 4 } else { 3 }, size as usize);
        let mut data = vec![0; channels * pixels];
        decoder.read_image(&mut data).map_err(|error| wrong(&error))?;
        let rgba = |v: &[u8]| [v[0], v[1], v[2], v.get(3).copied().unwrap_or(255)];
        Ok(Picture { width: width as usize, pixels: data.chunks_exact(channels).map(rgba).collect() })
    }
}
