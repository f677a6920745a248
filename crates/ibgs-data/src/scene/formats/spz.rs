//! Niantic's SPZ (github.com/nianticlabs/spz): written in version 3, read in versions 2 and 3.
//!
//! One gzip stream: a header of 16 bytes, then all positions (24-bit fixed point), opacities (a byte), colours (a byte a
//! channel of 0.15 dc + 0.5), scales (a byte in steps of 1/16 of the logarithm, from -10), rotations and spherical harmonics
//! (a byte each over -1 to 1, with 5 significant bits in degree 1 and 4 above). Rotations are the smallest three components of the quaternion in
//! 10 bits each; in version 2, x, y, z in a byte each.

use super::super::Gaussians;
use super::super::gaussians::coefficients;
use super::quantise::{self, byte};
use super::{MAX_SH_DEGREE, Steps, Writer, axes};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use std::f64::consts::FRAC_1_SQRT_2;
use std::io::{self, Read, Write};

pub(super) const ROW: super::Row = super::Row {
    name: "SPZ (Niantic)",
    ending: ".spz",
    marks: &[&[0x1f, 0x8b], b"NGSP"],
    axes: axes::RUB,
    max_sh_degree: MAX_SH_DEGREE,
    steps: Steps {
        rotation: FRAC_1_SQRT_2 / ROTATION_STEPS,
        sh: [1.0 / 255.0 / COLOR_SCALE, 1.0 / 16.0, 1.0 / 8.0, 1.0 / 8.0],
    },
    place_of_offset: None,
    writer: Some(writer),
    read: Some(|bytes, _| read(bytes)),
};

const MAGIC: [u8; 4] = *b"NGSP";
const HEADER: usize = 16;
/// Most bits behind the point that are written: steps of a millionth.
const MOST_FRACTIONAL_BITS: u32 = 20;
/// Largest coordinate in steps.
const MOST_STEPS: f64 = 8_388_607.0;
/// Colours are kept as `COLOR_SCALE` dc + 0.5: wider than their range.
const COLOR_SCALE: f64 = 0.15;
/// Steps of a component of a rotation, beside its sign.
const ROTATION_STEPS: f64 = 511.0;
/// No scene compresses so well; beyond it a file is not unpacked.
const MOST_RATIO: u64 = 200;
/// Files of any length may hold so many bytes.
const SMALL: u64 = 1 << 16;

/// Most bits behind the point with which all coordinates fit.
///
/// # Errors
/// Why there are none.
fn fractional_bits(gaussians: &Gaussians) -> Result<u32, String> {
    if gaussians.len() > i32::MAX as usize {
        return Err("an SPZ file holds up to 2,147,483,647 Gaussians".to_owned());
    }
    let far = gaussians.means.as_flattened().iter().fold(0.0, |far, v| f64::max(far, f64::from(v.abs())));
    let fits = |&bits: &u32| (far * f64::from(1 << bits)).round() <= MOST_STEPS;
    (0..=MOST_FRACTIONAL_BITS)
        .rev()
        .find(fits)
        .ok_or_else(|| format!("an SPZ file holds coordinates up to {MOST_STEPS}, the model's reach {far}"))
}

fn writer(gaussians: &Gaussians) -> Writer<'_> {
    let bits = fractional_bits(gaussians)?;
    Ok(Box::new(move |out| write(gaussians, bits, out)))
}

/// Writes version 3.
fn write(g: &Gaussians, fractional_bits: u32, out: &mut dyn Write) -> io::Result<()> {
    let mut gzip = GzEncoder::new(out, Compression::default());
    gzip.write_all(&MAGIC)?;
    gzip.write_all(&3_u32.to_le_bytes())?;
    gzip.write_all(&(g.len() as u32).to_le_bytes())?;
    gzip.write_all(&[g.sh_degree as u8, fractional_bits as u8, 0, 0])?;
    let steps = f64::from(1 << fractional_bits);
    for &v in g.means.as_flattened() {
        let fixed = (f64::from(v) * steps).round() as i32;
        gzip.write_all(&fixed.to_le_bytes()[..3])?;
    }
    let bytes = |values: &mut dyn Iterator<Item = u8>| values.collect::<Vec<u8>>();
    gzip.write_all(&bytes(&mut g.opacity_logits.iter().map(|&logit| quantise::opacity_byte(logit))))?;
    let row = 3 * g.sh_coefficients();
    let color = |dc: &f32| byte(255.0 * (COLOR_SCALE * f64::from(*dc) + 0.5));
    gzip.write_all(&bytes(&mut g.sh.chunks_exact(row).flat_map(|sh| &sh[..3]).map(color)))?;
    gzip.write_all(&bytes(&mut g.log_scales.as_flattened().iter().map(|&s| byte((f64::from(s) + 10.0) * 16.0))))?;
    for &rotation in &g.rotations {
        gzip.write_all(&pack_rotation(rotation).to_le_bytes())?;
    }
    for sh in g.sh.chunks_exact(row) {
        gzip.write_all(&bytes(&mut sh.iter().enumerate().skip(3).map(|(at, &v)| pack_harmonic(at / 3, v))))?;
    }
    gzip.finish()?;
    Ok(())
}

/// The index of the largest component in two bits, then sign and nine bits of the others.
fn pack_rotation(rotation: [f32; 4]) -> u32 {
    let (largest, others) = quantise::smallest_three(quantise::scalar_last(quantise::unit_quaternion(rotation)));
    others.into_iter().fold(largest as u32, |packed, v| {
        let magnitude = (v.abs() / FRAC_1_SQRT_2 * ROTATION_STEPS).round().min(ROTATION_STEPS) as u32;
        packed << 10 | u32::from(v < 0.0) << 9 | magnitude
    })
}

fn unpack_rotation(packed: u32) -> [f32; 4] {
    let component = |shift: u32| {
        let bits = packed >> shift & 0x3ff;
        let magnitude = f64::from(bits & 0x1ff) / ROTATION_STEPS * FRAC_1_SQRT_2;
        if bits >> 9 == 1 { -magnitude } else { magnitude }
    };
    let others = [component(20), component(10), component(0)];
    quantise::scalar_first(quantise::from_smallest_three((packed >> 30) as usize, others))
}

/// Five significant bits in degree 1, four above: zeros behind them compress.
fn pack_harmonic(coefficient: usize, value: f32) -> u8 {
    let bucket = if coefficient < 4 { 8.0 } else { 16.0 };
    byte(((f64::from(value) * 128.0 + 128.0) / bucket).round() * bucket)
}

/// What the header says.
struct Header {
    version: u32,
    count: usize,
    degree: u32,
    fractional_bits: u32,
}

impl Header {
    fn read(bytes: [u8; HEADER]) -> Result<Self, String> {
        let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        if bytes[..4] != MAGIC {
            return Err("what its gzip stream holds does not begin with `NGSP`".to_owned());
        }
        let [version, count] = [word(4), word(8)];
        if !(2..=3).contains(&version) {
            return Err(format!("it has version {version} of the format; versions 2 and 3 are read"));
        }
        let [degree, fractional_bits] = [bytes[12], bytes[13]].map(u32::from);
        if degree > MAX_SH_DEGREE {
            return Err(format!("its spherical harmonics have degree {degree}; degrees 0 to {MAX_SH_DEGREE} are read"));
        }
        if fractional_bits > 24 {
            return Err(format!("its coordinates have {fractional_bits} bits behind the point where 24 are all"));
        }
        Ok(Self { version, count: count as usize, degree, fractional_bits })
    }

    fn rotation_bytes(&self) -> usize {
        if self.version == 2 { 3 } else { 4 }
    }

    /// Bytes of each Gaussian by field, in the order of the file.
    fn row(&self) -> [usize; 6] {
        [9, 1, 3, 3, self.rotation_bytes(), 3 * (coefficients(self.degree) - 1)]
    }
}

/// Reads versions 2 and 3.
///
/// # Errors
/// What is wrong.
fn read(bytes: &[u8]) -> Result<Gaussians, String> {
    if bytes.starts_with(&MAGIC) {
        return Err("it has version 4 of the format; versions 2 and 3 are read".to_owned());
    }
    let damaged = |error: io::Error| format!("its gzip stream is damaged ({error})");
    let mut gzip = GzDecoder::new(bytes);
    let mut header = [0; HEADER];
    gzip.read_exact(&mut header).map_err(damaged)?;
    let header = Header::read(header)?;
    let row: usize = header.row().iter().sum();
    let needed = header.count as u64 * row as u64;
    if needed > SMALL.max(MOST_RATIO * bytes.len() as u64) {
        return Err(format!("it promises {} Gaussians, more than its {} bytes can hold", header.count, bytes.len()));
    }
    let mut data = Vec::new();
    gzip.by_ref().take(needed).read_to_end(&mut data).map_err(damaged)?;
    if (data.len() as u64) < needed {
        return Err(format!("it is truncated: it promises {} Gaussians and ends before", header.count));
    }
    // Extensions may follow. The checksum behind them shows damage.
    io::copy(&mut gzip.take(SMALL), &mut io::sink()).map_err(damaged)?;
    Ok(unpack(&header, &data))
}

/// The Gaussians in data of the length that the header promises.
fn unpack(header: &Header, data: &[u8]) -> Gaussians {
    let mut rest = data;
    let [positions, opacities, colors, scales, rotations, harmonics] = header.row().map(|row| {
        let (field, behind) = rest.split_at(row * header.count);
        rest = behind;
        field
    });
    let mut g = Gaussians::with_capacity(header.count, header.degree);
    let step = 1.0 / f64::from(1 << header.fractional_bits);
    // The three bytes stand above a fourth, so that the shift extends the sign.
    let fixed = |b: &[u8]| (f64::from(i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8) * step) as f32;
    g.means.extend(positions.chunks_exact(9).map(|p| [fixed(&p[..3]), fixed(&p[3..6]), fixed(&p[6..])]));
    g.opacity_logits.extend(opacities.iter().map(|&v| quantise::logit_of_byte(v)));
    g.log_scales.extend(scales.chunks_exact(3).map(|s| [s[0], s[1], s[2]].map(|v| f32::from(v) / 16.0 - 10.0)));
    g.rotations.extend(rotations.chunks_exact(header.rotation_bytes()).map(|r| match *r {
        [x, y, z] => first_three([x, y, z]),
        _ => unpack_rotation(u32::from_le_bytes([r[0], r[1], r[2], r[3]])),
    }));
    let higher = 3 * (coefficients(header.degree) - 1);
    for (index, color) in colors.chunks_exact(3).enumerate() {
        g.sh.extend(color.iter().map(|&v| ((f64::from(v) / 255.0 - 0.5) / COLOR_SCALE) as f32));
        g.sh.extend(harmonics[higher * index..higher * (index + 1)].iter().map(|&v| (f32::from(v) - 128.0) / 128.0));
    }
    g
}

/// The quaternion of version 2: x, y, z, and a w that is not negative.
fn first_three(bytes: [u8; 3]) -> [f32; 4] {
    let [x, y, z] = bytes.map(|v| f64::from(v) / 127.5 - 1.0);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    [w, x, y, z].map(|v| v as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::formats::Format;
    use crate::scene::formats::tests::{LARGEST, OPACITY, in_order, random, rounding, written};
    use crate::scene::{SH_C0, SceneError, read_gaussians_from, write_gaussians};
    use std::io::Cursor;
    use std::path::Path;

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

    /// y points up and z back.
    #[test]
    fn axes_are_those_of_the_format() {
        let mut g = random(1, 0, 50);
        g.means[0] = [0.5, 1.0, 2.0];
        let mut data = Vec::new();
        GzDecoder::new(written(&g, Format::Spz).as_slice()).read_to_end(&mut data).unwrap();
        // As many bits behind the point as there are.
        assert_eq!(data[..16], [b'N', b'G', b'S', b'P', 3, 0, 0, 0, 1, 0, 0, 0, 0, 20, 0, 0]);
        // 0.5, -1 and -2 in steps of 1/2^20.
        assert_eq!(data[16..25], [0, 0, 8, 0, 0, 0xf0, 0, 0, 0xe0]);
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
        let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
        gzip.write_all(&data).unwrap();
        let g = read_gaussians_from(&mut Cursor::new(gzip.finish().unwrap()), 1 << 20, Path::new("a")).unwrap();
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
