//! Reading of SOG files, see [`super::sog`]: version 2, and version 1, which has even steps in place of codebooks; as an
//! archive, or as a `meta.json` with its pictures beside it.

use super::super::Gaussians;
use super::quantise;
use super::sog::{ENTRIES_A_ROW, FIRST_LARGEST, MOST_POSITION, from_log};
use super::sog_meta::{Harmonics, Layout, Means};
use super::sog_parts::Parts;
use std::f64::consts::SQRT_2;
use std::path::Path;

/// Reads a whole archive.
///
/// # Errors
/// What is wrong.
pub(super) fn read(bytes: &[u8]) -> Result<Gaussians, String> {
    let (mut parts, layout) = open(bytes)?;
    gaussians(&mut parts, &layout)
}

/// Reads an archive as if its spherical harmonics had degree 0; it may lack the pictures of the others.
///
/// # Errors
/// What is wrong.
pub(super) fn read_base(bytes: &[u8]) -> Result<Gaussians, String> {
    let (mut parts, layout) = open(bytes)?;
    gaussians(&mut parts, &Layout { harmonics: None, ..layout })
}

/// Reads a `meta.json` at `path` and the pictures beside it.
///
/// # Errors
/// What is wrong.
pub(super) fn read_folder(text: &[u8], path: &Path) -> Result<Gaussians, String> {
    let (mut parts, mut length) = (Parts::beside(path), 0);
    let layout = Layout::parse(text, |layout| {
        length =
            layout.files().try_fold(0, |sum: u64, name| Ok::<_, String>(sum.saturating_add(parts.length(name)?)))?;
        Ok(length)
    })?;
    parts.limit(length);
    gaussians(&mut parts, &layout)
}

/// The pictures of an archive and what they mean.
fn open(bytes: &[u8]) -> Result<(Parts<'_>, Layout), String> {
    let mut parts = Parts::of_archive(bytes)?;
    let text = parts.meta()?;
    Ok((parts, Layout::parse(&text, |_| Ok(bytes.len() as u64))?))
}

fn gaussians(parts: &mut Parts, layout: &Layout) -> Result<Gaussians, String> {
    let higher = layout.harmonics.as_ref().map(|harmonics| Higher::open(parts, harmonics, layout.count)).transpose()?;
    let degree = higher.as_ref().map_or(0, |higher| (higher.width + 1).isqrt() as u32 - 1);
    let mut g = Gaussians::with_capacity(layout.count, degree);
    g.antialiased = layout.antialiased;
    means(parts, layout, &mut g)?;
    rotations(parts, layout, &mut g)?;
    scales(parts, layout, &mut g)?;
    colors(parts, layout, higher.as_ref(), &mut g)?;
    Ok(g)
}

fn means(parts: &mut Parts, layout: &Layout, g: &mut Gaussians) -> Result<(), String> {
    let Means { mins, maxs, files } = &layout.means;
    let low = parts.plane(&files[0], layout.count)?;
    let high = parts.plane(&files[1], layout.count)?;
    g.means.extend(low.iter().zip(high).take(layout.count).map(|(low, high)| {
        [0, 1, 2].map(|axis| {
            let part = f64::from(u16::from_le_bytes([low[axis], high[axis]])) / f64::from(MOST_POSITION);
            from_log(mins[axis] + (maxs[axis] - mins[axis]) * part) as f32
        })
    }));
    Ok(())
}

fn rotations(parts: &mut Parts, layout: &Layout, g: &mut Gaussians) -> Result<(), String> {
    let plane = parts.plane(&layout.rotations, layout.count)?;
    g.rotations.extend(plane[..layout.count].iter().map(|&[a, b, c, tag]| {
        let others = [a, b, c].map(|v| (f64::from(v) / 255.0 * 2.0 - 1.0) / SQRT_2);
        match tag.checked_sub(FIRST_LARGEST) {
            Some(largest) => quantise::from_smallest_three(largest.into(), others),
            None => [1.0, 0.0, 0.0, 0.0],
        }
    }));
    Ok(())
}

fn scales(parts: &mut Parts, layout: &Layout, g: &mut Gaussians) -> Result<(), String> {
    let plane = parts.plane(&layout.scales.file, layout.count)?;
    for pixel in &plane[..layout.count] {
        g.log_scales.push(triple(&layout.scales.codes, pixel, "scales")?);
    }
    Ok(())
}

/// Colours of every degree, and opacities.
fn colors(parts: &mut Parts, layout: &Layout, higher: Option<&Higher>, g: &mut Gaussians) -> Result<(), String> {
    let plane = parts.plane(&layout.colors.file, layout.count)?;
    for (index, pixel) in plane[..layout.count].iter().enumerate() {
        g.opacity_logits.push(layout.opacities[usize::from(pixel[3])]);
        g.sh.extend(triple(&layout.colors.codes, pixel, "sh0")?);
        if let Some(higher) = higher {
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
    /// How many entries there are.
    count: usize,
    /// Coefficients a channel.
    width: usize,
}

impl<'a> Higher<'a> {
    fn open(parts: &mut Parts, harmonics: &'a Harmonics, count: usize) -> Result<Self, String> {
        let name = &harmonics.palette;
        let picture = parts.picture(name, usize::from(u16::MAX) + 1)?;
        let rows = picture.pixels.len() / picture.width.max(1);
        let [entries, width] = harmonics.size.unwrap_or([ENTRIES_A_ROW * rows, picture.width / ENTRIES_A_ROW]);
        let is_whole = picture.width == ENTRIES_A_ROW * width && rows >= entries.div_ceil(ENTRIES_A_ROW);
        if !is_whole || ![3, 8, 15].contains(&width) {
            return Err(match harmonics.size {
                Some(_) => format!("its `{name}` is no palette of {entries} entries"),
                None => format!("its `{name}` is {} pixels wide, which no palette is", picture.width),
            });
        }
        let labels = parts.plane(&harmonics.labels, count)?;
        Ok(Self { harmonics, labels, entries: picture.pixels, count: entries, width })
    }

    fn append(&self, index: usize, sh: &mut Vec<f32>) -> Result<(), String> {
        let label = usize::from(u16::from_le_bytes([self.labels[index][0], self.labels[index][1]]));
        if label >= self.count {
            return Err(format!("Gaussian {index} has the entry {label} of a palette of {}", self.count));
        }
        // 64 entries fill a row of the picture, so they follow one another.
        for pixel in &self.entries[self.width * label..self.width * (label + 1)] {
            for &channel in &pixel[..3] {
                sh.push(code(&self.harmonics.codes, channel, "shN")?);
            }
        }
        Ok(())
    }
}

/// What the red, green and blue of a pixel stand for.
fn triple(codes: &[Vec<f32>; 3], &[red, green, blue, _]: &[u8; 4], field: &str) -> Result<[f32; 3], String> {
    Ok([code(&codes[0], red, field)?, code(&codes[1], green, field)?, code(&codes[2], blue, field)?])
}

fn code(codebook: &[f32], at: u8, field: &str) -> Result<f32, String> {
    let missing = || format!("the codebook of its `{field}` has {} entries, not the entry {at}", codebook.len());
    codebook.get(usize::from(at)).copied().ok_or_else(missing)
}
