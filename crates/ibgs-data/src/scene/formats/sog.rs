//! PlayCanvas' SOG, version 2 (developer.playcanvas.com, "The SOG Format"), as one ZIP archive or as a folder; writing.
//!
//! `meta.json` and lossless WebP pictures with a pixel a Gaussian: positions as 16 bits of sign(x) ln(1 + |x|) between bounds
//! in two pictures, the smallest three components of the quaternion as bytes with the place of the largest in alpha, scales
//! and colours of degree 0 as places in codebooks of 256 numbers, opacity as a byte. The higher coefficients are those of an
//! entry of a palette of up to 65,536 rows, whose numbers are places in a third codebook. Axes are those of 3DGS, as the
//! programs of the format's authors have them.

use super::super::{Gaussians, SceneError};
use super::palette::{Codebook, Palette};
use super::{MAX_SH_DEGREE, Steps, Writer, Writing, axes, order, quantise, sog_read, sog_streamed};
use crate::files::write_atomically;
use crate::stored_zip;
use image_webp::{ColorType, WebPEncoder};
use serde_json::{Value, json};
use std::f64::consts::SQRT_2;
use std::io::{self, Cursor};
use std::path::Path;

pub(super) const ROW: super::Row = super::Row {
    name: "SOG (PlayCanvas)",
    ending: ".sog",
    marks: &[b"PK\x03\x04"],
    axes: axes::RDF,
    max_sh_degree: MAX_SH_DEGREE,
    steps: Steps { rotation: SQRT_2 / 255.0, sh: [0.0; 4] },
    // Half of the range of sign(x) ln(1 + |x|) on either side.
    position_step: Some(|reach, at| 2.0 * to_log(reach) / f64::from(MOST_POSITION) * (1.0 + at)),
    keeps_antialiased: true,
    place_of_offset: None,
    writing: Writing::By(writer),
    read: Some(|bytes, _| sog_read::read(bytes)),
};
/// The same without an archive.
pub(super) const FOLDER: super::Row = super::Row {
    name: "SOG (PlayCanvas) in a folder",
    ending: "meta.json",
    marks: &[],
    writing: Writing::Never,
    read: Some(sog_streamed::read_folder),
    ..ROW
};

fn writer(gaussians: &Gaussians) -> Writer<'_> {
    let bytes = encode(gaussians, order::morton(gaussians))?;
    Ok(Box::new(move |out| out.write_all(&bytes)))
}

/// The `model` of Gaussians that were trained with antialiasing.
pub(super) const ANTIALIASED: &str = "antialiased";
/// Largest side of a WebP picture.
pub(super) const MOST_SIDE: usize = 16_384;
/// Entries of the palette that lie side by side.
pub(super) const ENTRIES_A_ROW: usize = 64;
/// Most entries of the palette, in steps of which it grows.
const MOST_ENTRIES: usize = 64 * ENTRY_STEP;
const ENTRY_STEP: usize = 1024;
/// Alpha of quaternions whose first component is the largest.
pub(super) const FIRST_LARGEST: u8 = 252;
/// What the names of the higher coefficients' pictures begin with; they are the last ones.
pub(super) const HARMONICS: &str = "shN_";
/// Largest value of a position.
pub(super) const MOST_POSITION: u32 = 65_535;

/// The bytes of an archive with the Gaussians in an order.
///
/// # Errors
/// Why the format cannot hold the model.
pub(super) fn encode(g: &Gaussians, order: Vec<usize>) -> Result<Vec<u8>, String> {
    let (meta, files) = parts(g, order)?;
    let mut out = Cursor::new(Vec::new());
    let written = stored_zip::write(&mut out, |zip| {
        stored_zip::add(zip, "meta.json", meta.as_bytes())?;
        files.iter().try_for_each(|(name, bytes)| stored_zip::add(zip, name, bytes))
    });
    written.map(|()| out.into_inner()).map_err(|error| error.to_string())
}

/// Writes a folder with parts of a model one after the other, their Gaussians in an order of the part's own: `meta.json` at
/// `path`, the pictures beside it.
///
/// # Errors
/// [`SceneError::CannotHold`] where they are too many, and [`SceneError::Write`].
pub fn write_sog_folder(path: &Path, model: &[Gaussians]) -> Result<(), SceneError> {
    let all = Gaussians::joined(model.to_vec());
    let mut order = Vec::with_capacity(all.len());
    for part in model {
        let first = order.len();
        order.extend(order::morton(part).into_iter().map(|row| first + row));
    }
    let (meta, files) =
        parts(&all, order).map_err(|reason| SceneError::CannotHold { path: path.to_owned(), reason })?;
    for (name, bytes) in files {
        write_atomically(&path.with_file_name(name), |out| out.write_all(&bytes))?;
    }
    write_atomically(path, |out| out.write_all(meta.as_bytes()))?;
    Ok(())
}

/// The text of the `meta.json` of Gaussians in an order, and the pictures with their names.
fn parts(g: &Gaussians, order: Vec<usize>) -> Result<(String, Files), String> {
    let width = ((g.len() as f64).sqrt() as usize + 1).next_multiple_of(4);
    let height = g.len().div_ceil(width);
    if width > MOST_SIDE {
        return Err(format!("a SOG file holds up to {} Gaussians, the model has {}", MOST_SIDE * MOST_SIDE, g.len()));
    }
    Planes { g, order, width, height }.encode().map_err(|error| error.to_string())
}

type Files = Vec<(&'static str, Vec<u8>)>;

/// The Gaussians as pixels.
struct Planes<'a> {
    g: &'a Gaussians,
    order: Vec<usize>,
    width: usize,
    height: usize,
}

impl Planes<'_> {
    fn encode(&self) -> io::Result<(String, Files)> {
        let mut files = Files::new();
        let mut meta = json!({"version": 2, "asset": {"generator": "ibgs"}, "count": self.g.len()});
        if self.g.antialiased {
            meta["model"] = json!(ANTIALIASED);
        }
        self.means(&mut meta, &mut files)?;
        self.rotations(&mut meta, &mut files)?;
        self.scales(&mut meta, &mut files)?;
        self.colors(&mut meta, &mut files)?;
        if self.g.sh_degree > 0 {
            self.harmonics(&mut meta, &mut files)?;
        }
        Ok((meta.to_string(), files))
    }

    /// A picture with a pixel for each Gaussian.
    fn picture(&self, pixel: impl Fn(usize) -> [u8; 4]) -> io::Result<Vec<u8>> {
        let mut rgba: Vec<u8> = self.order.iter().flat_map(|&index| pixel(index)).collect();
        rgba.resize(4 * self.width * self.height, 0);
        webp(&rgba, self.width, self.height)
    }

    fn means(&self, meta: &mut Value, files: &mut Files) -> io::Result<()> {
        let logs: Vec<[f64; 3]> = self.g.means.iter().map(|mean| mean.map(|v| to_log(f64::from(v)))).collect();
        let fold = |start: f64, choose: fn(f64, f64) -> f64| -> [f64; 3] {
            logs.iter().fold([start; 3], |a, b| std::array::from_fn(|axis| choose(a[axis], b[axis])))
        };
        let (mins, maxs) = (fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max));
        let part = |index: usize, axis: usize| {
            let range = maxs[axis] - mins[axis];
            let part = if range > 0.0 { (logs[index][axis] - mins[axis]) / range } else { 0.0 };
            quantise::unit(part, MOST_POSITION) as u16
        };
        let byte = |index: usize, which: usize| {
            let [x, y, z] = [0, 1, 2].map(|axis| part(index, axis).to_le_bytes()[which]);
            [x, y, z, 255]
        };
        files.push(("means_l.webp", self.picture(|index| byte(index, 0))?));
        files.push(("means_u.webp", self.picture(|index| byte(index, 1))?));
        meta["means"] = json!({"mins": mins, "maxs": maxs, "files": ["means_l.webp", "means_u.webp"]});
        Ok(())
    }

    fn rotations(&self, meta: &mut Value, files: &mut Files) -> io::Result<()> {
        let pixel = |index: usize| {
            let (largest, others) = quantise::smallest_three(quantise::unit_quaternion(self.g.rotations[index]));
            let [a, b, c] = others.map(|v| quantise::byte(255.0 * (0.5 * SQRT_2 * v + 0.5)));
            [a, b, c, FIRST_LARGEST + largest as u8]
        };
        files.push(("quats.webp", self.picture(pixel)?));
        meta["quats"] = json!({"files": ["quats.webp"]});
        Ok(())
    }

    fn scales(&self, meta: &mut Value, files: &mut Files) -> io::Result<()> {
        let codes = Codebook::fit(self.g.log_scales.as_flattened().iter().copied());
        let pixel = |index: usize| {
            let [x, y, z] = self.g.log_scales[index].map(|v| codes.nearest(v));
            [x, y, z, 255]
        };
        files.push(("scales.webp", self.picture(pixel)?));
        meta["scales"] = json!({"codebook": codes.0, "files": ["scales.webp"]});
        Ok(())
    }

    fn colors(&self, meta: &mut Value, files: &mut Files) -> io::Result<()> {
        let row = 3 * self.g.sh_coefficients();
        let dc = |index: usize| [0, 1, 2].map(|channel| self.g.sh[row * index + channel]);
        let codes = Codebook::fit((0..self.g.len()).flat_map(dc));
        let pixel = |index: usize| {
            let [r, g, b] = dc(index).map(|v| codes.nearest(v));
            [r, g, b, quantise::opacity_byte(self.g.opacity_logits[index])]
        };
        files.push(("sh0.webp", self.picture(pixel)?));
        meta["sh0"] = json!({"codebook": codes.0, "files": ["sh0.webp"]});
        Ok(())
    }

    fn harmonics(&self, meta: &mut Value, files: &mut Files) -> io::Result<()> {
        let row = 3 * self.g.sh_coefficients();
        let higher: Vec<f32> = self.g.sh.chunks_exact(row).flat_map(|sh| &sh[3..]).copied().collect();
        let width = row - 3;
        let palette = Palette::fit(&higher, width, entries(self.g.len()));
        drop(higher);
        let codes = Codebook::fit(palette.entries.iter().copied());
        let mut rgba: Vec<u8> = palette
            .entries
            .chunks_exact(3)
            .flat_map(|rgb| [codes.nearest(rgb[0]), codes.nearest(rgb[1]), codes.nearest(rgb[2]), 255])
            .collect();
        let count = palette.entries.len() / width;
        let [w, h] = [ENTRIES_A_ROW * width / 3, count.div_ceil(ENTRIES_A_ROW)];
        rgba.resize(4 * w * h, 0);
        files.push(("shN_centroids.webp", webp(&rgba, w, h)?));
        let pixel = |index: usize| {
            let [low, high] = (palette.labels[index] as u16).to_le_bytes();
            [low, high, 0, 255]
        };
        files.push(("shN_labels.webp", self.picture(pixel)?));
        let names = ["shN_centroids.webp", "shN_labels.webp"];
        meta["shN"] = json!({"count": count, "bands": self.g.sh_degree, "codebook": codes.0, "files": names});
        Ok(())
    }
}

/// Most entries of the palette of so many Gaussians: all of them in small models, then a power of two of steps.
fn entries(count: usize) -> usize {
    match count / ENTRY_STEP {
        0 => count,
        steps => MOST_ENTRIES.min(ENTRY_STEP << steps.ilog2()),
    }
}

/// sign(x) ln(1 + |x|).
fn to_log(x: f64) -> f64 {
    x.abs().ln_1p().copysign(x)
}

/// The inverse of it.
pub(super) fn from_log(x: f64) -> f64 {
    x.abs().exp_m1().copysign(x)
}

fn webp(rgba: &[u8], width: usize, height: usize) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    WebPEncoder::new(&mut bytes)
        .encode(rgba, width as u32, height as u32, ColorType::Rgba8)
        .map_err(io::Error::other)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::formats::Format;
    use crate::scene::formats::tests::{LARGEST, OPACITY, errors, random, round_trip, rounding};

    #[test]
    fn errors_are_those_of_its_bits_and_codebooks() {
        for degree in 0..=3 {
            let g = random(700, degree, 30 + u64::from(degree));
            let order = order::morton(&g);
            let back = round_trip(&g, Format::Sog);
            let e = errors(&g, &back, &order);
            // 16 bits of ln(1 + |x|), whose slope is 1 / (1 + |x|).
            assert!(e.mean <= 41.0 * 0.5 * 41.0_f64.ln() / 65535.0 + rounding(40.0), "{e:?}");
            assert!(e.opacity <= OPACITY, "{e:?}");
            assert!(e.rotation <= LARGEST * 0.5 / 255.0 * SQRT_2, "{e:?}");
            // Half of the 256 codes begin as even steps over the range, and the mean square only falls from there: that of half a
            // step is the most it can be.
            let half_step = |range: f64| 0.5 * range / 127.0;
            let row = 3 * g.sh_coefficients();
            let root_mean_square =
                |values: Vec<f32>| (values.iter().map(|v| f64::from(v * v)).sum::<f64>() / values.len() as f64).sqrt();
            let scales =
                order.iter().zip(&back.log_scales).flat_map(|(&i, b)| [0, 1, 2].map(|k| g.log_scales[i][k] - b[k]));
            assert!(root_mean_square(scales.collect()) <= half_step(8.0), "{e:?}");
            // As many entries as Gaussians in the palette, so that only the codebooks are inexact.
            let sh = order.iter().enumerate().flat_map(|(at, &i)| (0..row).map(move |k| (row * at + k, row * i + k)));
            assert!(root_mean_square(sh.map(|(b, a)| g.sh[a] - back.sh[b]).collect()) <= half_step(1.8), "{e:?}");
        }
    }
}
