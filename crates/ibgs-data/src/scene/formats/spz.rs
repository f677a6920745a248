//! Niantic's SPZ (github.com/nianticlabs/spz): written in version 4, on request in version 3; read in versions 2 to 4.
//!
//! A header and six fields: positions (24-bit fixed point), opacities (a byte), colours (a byte a channel of 0.15 dc + 0.5),
//! scales (a byte in steps of 1/16 of the logarithm, from -10), rotations and spherical harmonics (a byte each over -1 to 1,
//! with 5 significant bits in degree 1 and 4 above). Rotations are the smallest three components of the quaternion in 10 bits
//! each; in version 2, x, y, z in a byte each. Up to version 3 all of it is one gzip stream. In version 4 a header of 32 bytes
//! and a table of the fields' lengths are plain, and each field is a Zstandard frame.

use super::super::{Gaussians, SceneError};
use super::quantise::{self, byte};
use super::{Format, MAX_SH_DEGREE, Steps, Writer, Writing, axes, spz_read};
use flate2::Compression;
use flate2::write::GzEncoder;
use std::f64::consts::FRAC_1_SQRT_2;
use std::io::{self, Write};
use std::path::Path;

pub(super) const ROW: super::Row = super::Row {
    name: "SPZ (Niantic)",
    ending: ".spz",
    marks: &[&[0x1f, 0x8b], MAGIC],
    axes: axes::RUB,
    max_sh_degree: MAX_SH_DEGREE,
    steps: Steps {
        rotation: FRAC_1_SQRT_2 / ROTATION_STEPS,
        sh: [1.0 / 255.0 / COLOR_SCALE, 1.0 / 16.0, 1.0 / 8.0, 1.0 / 8.0],
    },
    position_step: Some(|reach, _| 0.5_f64.powi(bits_behind_the_point(reach).unwrap_or_default() as i32)),
    keeps_antialiased: true,
    place_of_offset: None,
    writing: Writing::By(|gaussians| writer(gaussians, write_4)),
    read: Some(|bytes, _| spz_read::read(bytes)),
};

/// A version of SPZ that is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpzVersion {
    /// One gzip stream, which programs from before 2026 read.
    V3,
    /// Zstandard, a frame for each field.
    #[default]
    V4,
}

/// Writes an SPZ file of a version, as [`write_gaussians`](super::write_gaussians) writes one of the default version.
///
/// # Errors
/// As [`write_gaussians`](super::write_gaussians).
pub fn write_spz(path: &Path, gaussians: &Gaussians, version: SpzVersion) -> Result<(), SceneError> {
    super::write_with(path, gaussians, Format::Spz.row().axes, |gaussians| match version {
        SpzVersion::V3 => writer(gaussians, write_3),
        SpzVersion::V4 => writer(gaussians, write_4),
    })
}

pub(super) const MAGIC: &[u8; 4] = b"NGSP";
/// Bytes of the header of version 4.
pub(super) const HEADER_4: usize = 32;
/// Bytes of a field in the table of version 4: compressed and plain length.
pub(super) const TABLE_ROW: usize = 16;
/// The flag of Gaussians that were trained with antialiasing.
pub(super) const ANTIALIASED: u8 = 1;
/// Most bits behind the point that are written: steps of a millionth.
const MOST_FRACTIONAL_BITS: u32 = 20;
/// Largest coordinate in steps.
const MOST_STEPS: f64 = 8_388_607.0;
/// Colours are kept as `COLOR_SCALE` dc + 0.5: wider than their range.
pub(super) const COLOR_SCALE: f64 = 0.15;
/// Steps of a component of a rotation, beside its sign.
pub(super) const ROTATION_STEPS: f64 = 511.0;
/// Level of Zstandard, as Niantic's library has it: more hardly makes files smaller.
#[cfg(not(target_family = "wasm"))]
const ZSTD_LEVEL: i32 = 12;

/// Most bits behind the point with which all coordinates fit.
///
/// # Errors
/// Why there are none.
fn fractional_bits(gaussians: &Gaussians) -> Result<u32, String> {
    if gaussians.len() > i32::MAX as usize {
        return Err("an SPZ file holds up to 2,147,483,647 Gaussians".to_owned());
    }
    let far = gaussians.means.as_flattened().iter().fold(0.0, |far, v| f64::max(far, f64::from(v.abs())));
    bits_behind_the_point(far)
        .ok_or_else(|| format!("an SPZ file holds coordinates up to {MOST_STEPS}, the model's reach {far}"))
}

/// Most bits behind the point with which a coordinate fits.
fn bits_behind_the_point(far: f64) -> Option<u32> {
    (0..=MOST_FRACTIONAL_BITS).rev().find(|&bits| (far * f64::from(1 << bits)).round() <= MOST_STEPS)
}

/// Writes fields with the bits behind the point of a coordinate.
type WriteFields = fn(&Gaussians, u32, &mut dyn Write) -> io::Result<()>;

fn writer(gaussians: &Gaussians, write: WriteFields) -> Writer<'_> {
    let bits = fractional_bits(gaussians)?;
    Ok(Box::new(move |out| write(gaussians, bits, out)))
}

/// The first 15 bytes of the header of every version.
fn header(g: &Gaussians, version: u32, fractional_bits: u32) -> Vec<u8> {
    let mut header = MAGIC.to_vec();
    header.extend(version.to_le_bytes());
    header.extend((g.len() as u32).to_le_bytes());
    header.extend([g.sh_degree as u8, fractional_bits as u8, if g.antialiased { ANTIALIASED } else { 0 }]);
    header
}

fn write_3(g: &Gaussians, fractional_bits: u32, out: &mut dyn Write) -> io::Result<()> {
    let mut gzip = GzEncoder::new(out, Compression::default());
    gzip.write_all(&header(g, 3, fractional_bits))?;
    gzip.write_all(&[0])?;
    fields(g, fractional_bits).iter().try_for_each(|field| gzip.write_all(field))?;
    gzip.finish()?;
    Ok(())
}

fn write_4(g: &Gaussians, fractional_bits: u32, out: &mut dyn Write) -> io::Result<()> {
    let mut fields: Vec<Vec<u8>> = fields(g, fractional_bits).into();
    // Colours that do not depend on the view have no sixth field.
    fields.retain(|field| !field.is_empty());
    let mut start = header(g, 4, fractional_bits);
    start.push(fields.len() as u8);
    start.extend((HEADER_4 as u32).to_le_bytes());
    start.resize(HEADER_4, 0);
    let mut streams = Vec::with_capacity(fields.len());
    for field in fields {
        let stream = compressed(&field)?;
        start.extend((stream.len() as u64).to_le_bytes());
        start.extend((field.len() as u64).to_le_bytes());
        streams.push(stream);
    }
    out.write_all(&start)?;
    streams.iter().try_for_each(|stream| out.write_all(stream))
}

/// A Zstandard frame with its checksum.
#[cfg(not(target_family = "wasm"))]
fn compressed(field: &[u8]) -> io::Result<Vec<u8>> {
    let mut compressor = zstd::bulk::Compressor::new(ZSTD_LEVEL)?;
    compressor.include_checksum(true)?;
    compressor.compress(field)
}

/// A Zstandard frame with its checksum, in Rust alone: a third larger.
#[cfg(target_family = "wasm")]
fn compressed(field: &[u8]) -> io::Result<Vec<u8>> {
    use ruzstd::encoding::{CompressionLevel, compress_to_vec};
    Ok(compress_to_vec(field, CompressionLevel::Fastest))
}

/// The fields in the order of the file.
fn fields(g: &Gaussians, fractional_bits: u32) -> [Vec<u8>; 6] {
    let steps = f64::from(1 << fractional_bits);
    let fixed = |v: &f32| -> [u8; 3] {
        let [low, middle, high, _] = ((f64::from(*v) * steps).round() as i32).to_le_bytes();
        [low, middle, high]
    };
    let row = 3 * g.sh_coefficients();
    let color = |dc: &f32| byte(255.0 * (COLOR_SCALE * f64::from(*dc) + 0.5));
    let higher =
        |sh: &[f32]| -> Vec<u8> { sh.iter().enumerate().skip(3).map(|(at, &v)| pack_harmonic(at / 3, v)).collect() };
    [
        g.means.as_flattened().iter().flat_map(fixed).collect(),
        g.opacity_logits.iter().map(|&logit| quantise::opacity_byte(logit)).collect(),
        g.sh.chunks_exact(row).flat_map(|sh| &sh[..3]).map(color).collect(),
        g.log_scales.as_flattened().iter().map(|&s| byte((f64::from(s) + 10.0) * 16.0)).collect(),
        g.rotations.iter().flat_map(|&rotation| pack_rotation(rotation).to_le_bytes()).collect(),
        g.sh.chunks_exact(row).flat_map(higher).collect(),
    ]
}

/// The index of the largest component in two bits, then sign and nine bits of the others.
fn pack_rotation(rotation: [f32; 4]) -> u32 {
    let (largest, others) = quantise::smallest_three(quantise::scalar_last(quantise::unit_quaternion(rotation)));
    others.into_iter().fold(largest as u32, |packed, v| {
        let magnitude = (v.abs() / FRAC_1_SQRT_2 * ROTATION_STEPS).round().min(ROTATION_STEPS) as u32;
        packed << 10 | u32::from(v < 0.0) << 9 | magnitude
    })
}

/// Five significant bits in degree 1, four above: zeros behind them compress.
fn pack_harmonic(coefficient: usize, value: f32) -> u8 {
    let bucket = if coefficient < 4 { 8.0 } else { 16.0 };
    byte(((f64::from(value) * 128.0 + 128.0) / bucket).round() * bucket)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::formats::Format;
    use crate::scene::formats::tests::read_named;
    use crate::scene::formats::tests::{LARGEST, OPACITY, in_order, random, rounding, written};
    use crate::scene::{SH_C0, write_gaussians};
    use flate2::read::GzDecoder;
    use std::io::Read;

    #[test]
    fn errors_are_half_a_step() {
        for degree in 0..=3 {
            let g = random(700, degree, u64::from(degree));
            let e = in_order(&g, Format::Spz);
            // 40 in 23 bits leaves 17 behind the point.
            assert!(e.mean <= 0.5 / f64::from(1 << 17) + rounding(40.0), "{e:?}");
            assert!(e.mean >= 0.4 / f64::from(1 << 17), "more bits than it has: {e:?}");
            assert!(e.log_scale <= 0.5 / 16.0 + rounding(10.0), "{e:?}");
            assert!(e.opacity <= OPACITY, "{e:?}");
            // 511 steps up to 1 / sqrt(2).
            assert!(e.rotation <= LARGEST * 0.5 / 511.0 * FRAC_1_SQRT_2, "{e:?}");
            assert!(e.color <= 0.5 / 255.0 / 0.15 * SH_C0 + rounding(4.0), "{e:?}");
            // 32 and 16 steps over -1 to 1.
            assert!(
                e.harmonics[0] <= 0.5 / 16.0 + rounding(1.0) && e.harmonics[1] <= 0.5 / 8.0 + rounding(1.0),
                "{e:?}"
            );
        }
    }

    fn gzip(data: &[u8]) -> Vec<u8> {
        let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
        gzip.write_all(data).unwrap();
        gzip.finish().unwrap()
    }

    fn version_3_of(g: &Gaussians) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.spz");
        write_spz(&path, g, SpzVersion::V3).unwrap();
        std::fs::read(path).unwrap()
    }

    /// y points up and z back.
    #[test]
    fn axes_are_those_of_the_format() {
        let mut g = random(1, 0, 50);
        g.means[0] = [0.5, 1.0, 2.0];
        let mut data = Vec::new();
        GzDecoder::new(version_3_of(&g).as_slice()).read_to_end(&mut data).unwrap();
        // As many bits behind the point as there are.
        assert_eq!(data[..16], [b'N', b'G', b'S', b'P', 3, 0, 0, 0, 1, 0, 0, 0, 0, 20, 0, 0]);
        // 0.5, -1 and -2 in steps of 1/2^20.
        assert_eq!(data[16..25], [0, 0, 8, 0, 0, 0xf0, 0, 0, 0xe0]);
    }

    #[test]
    fn versions_3_and_4_hold_the_same() {
        for degree in 0..=3 {
            let g = random(300, degree, 60);
            let [three, four] = [version_3_of(&g), written(&g, Format::Spz)];
            assert!(three.starts_with(&[0x1f, 0x8b]) && four.starts_with(b"NGSP\x04\0\0\0"));
            assert_eq!(four[15], if degree == 0 { 5 } else { 6 }, "fields");
            assert_eq!(read_named(&three, "a").unwrap(), read_named(&four, "b").unwrap());
        }
    }

    /// A Zstandard frame of one block that is not compressed, without checksum.
    fn frame(data: &[u8]) -> Vec<u8> {
        let block = (data.len() as u32) << 3 | 1;
        [&[0x28, 0xb5, 0x2f, 0xfd, 0x20, data.len() as u8], &block.to_le_bytes()[..3], data].concat()
    }

    /// A file of version 4 with one Gaussian, by hand; `fields` are frames, `extensions` stand before their table.
    fn by_hand(fields: &[Vec<u8>], extensions: &[u8]) -> Vec<u8> {
        let flags = if extensions.is_empty() { 0 } else { 2 };
        let mut file = [b"NGSP\x04\0\0\0\x01\0\0\0\x00\x0c".as_slice(), &[flags, fields.len() as u8]].concat();
        file.extend((32 + extensions.len() as u32).to_le_bytes());
        file.resize(32, 0);
        file.extend(extensions);
        fields.iter().for_each(|field| file.extend([field.len() as u64, 0].map(u64::to_le_bytes).concat()));
        [file, fields.concat()].concat()
    }

    fn one_gaussian() -> Vec<Vec<u8>> {
        let turn = 3_u32 << 30;
        let fields: [&[u8]; 5] =
            [&[0, 16, 0, 0, 0, 0, 0, 0xf0, 0xff], &[128], &[128; 3], &[160, 160, 0], &turn.to_le_bytes()];
        fields.map(frame).into()
    }

    #[test]
    fn version_4() {
        let unknown = [7, 0, 0, 0, 2, 0, 0, 0, 9, 9];
        let usual_axes = [[3, 0, 0xbe, 0xad], [4, 0, 0, 0], [4, 0, 0, 0]].concat();
        for extensions in [&[][..], &unknown, &usual_axes, &[unknown.as_slice(), &usual_axes].concat()] {
            let g = read_named(&by_hand(&one_gaussian(), extensions), "a").unwrap();
            assert_eq!((&g.means, &g.rotations), (&vec![[1.0, 0.0, 1.0]], &vec![[1.0, 0.0, 0.0, 0.0]]));
            assert_eq!((&g.log_scales, g.sh_degree), (&vec![[0.0, 0.0, -10.0]], 0));
        }
        let refused = |file: &[u8]| read_named(file, "a.spz").unwrap_err().to_string();
        let other_axes = [[3, 0, 0xbe, 0xad], [4, 0, 0, 0], [6, 0, 0, 0]].concat();
        assert!(refused(&by_hand(&one_gaussian(), &other_axes)).contains("the axes 6"));
        assert!(refused(&by_hand(&one_gaussian(), &[7, 0, 0, 0, 9, 0, 0, 0])).contains("behind their end"));
        assert!(refused(&by_hand(&one_gaussian()[..4], &[])).contains("lacks the field of its rotations"));
        let mut fields = one_gaussian();
        fields[2] = frame(&[128; 2]);
        assert!(refused(&by_hand(&fields, &[])).contains("colours holds 2 bytes where 3 are needed"));
        fields[2] = frame(&[128; 4]);
        assert!(refused(&by_hand(&fields, &[])).contains("colours holds more bytes where 3"));
        fields[2] = frame(&[])[..3].to_vec();
        assert!(refused(&by_hand(&fields, &[])).contains("colours is damaged"));
        let mut inside = by_hand(&one_gaussian(), &[]);
        inside[16] = 8;
        assert!(refused(&inside).contains("begins at byte 8"));
        inside[16..20].fill(0xff);
        assert!(refused(&inside).contains("truncated"));
        let mut lies = by_hand(&one_gaussian(), &[]);
        lies[32..40].fill(0xff);
        assert!(refused(&lies).contains("truncated"));
    }

    #[test]
    fn checksums_show_damage() {
        let mut file = written(&random(300, 1, 61), Format::Spz);
        let last = file.len() - 1;
        file[last] ^= 1;
        let text = read_named(&file, "a").unwrap_err().to_string();
        assert!(text.contains("harmonics is damaged (its checksum differs)"), "{text}");
    }

    /// A file of version 2, by hand: two Gaussians with x, y, z of their quaternions.
    #[test]
    fn version_2() {
        let mut data = b"NGSP\x02\0\0\0\x02\0\0\0\x00\x0c\0\0".to_vec();
        data.extend([0, 16, 0, 0, 0, 0, 0, 0xf0, 0xff, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        data.extend([128, 255]);
        data.extend([128; 6]);
        data.extend([160, 160, 160, 0, 0, 0]);
        data.extend([255, 128, 128, 128, 128, 128]);
        let g = read_named(&gzip(&data), "a").unwrap();
        assert_eq!(g.means, [[1.0, 0.0, 1.0], [0.0; 3]]);
        assert_eq!(g.log_scales, [[0.0; 3], [-10.0; 3]]);
        assert!(g.rotations[0][1] > 0.999 && g.rotations[1][0] > 0.999, "{:?}", g.rotations);
    }

    #[test]
    fn models_that_it_cannot_hold() {
        let path = tempfile::tempdir().unwrap().path().join("a.spz");
        let refused = |g: &Gaussians| {
            let error = write_gaussians(&path, g, Format::Spz).unwrap_err();
            assert!(!path.exists());
            error
        };
        let mut far = random(2, 0, 70);
        far.means[1][2] = -1e7;
        let error = refused(&far);
        assert!(matches!(error, SceneError::CannotHold { .. }) && error.to_string().contains("8388607"), "{error}");
    }
}
