//! Reading of SPZ files, see [`super::spz`].

use super::super::Gaussians;
use super::super::gaussians::coefficients;
use super::spz::{ANTIALIASED, COLOR_SCALE, HEADER_4, MAGIC, ROTATION_STEPS, TABLE_ROW};
use super::{MAX_SH_DEGREE, quantise};
use flate2::read::GzDecoder;
use ruzstd::decoding::StreamingDecoder;
use std::f64::consts::FRAC_1_SQRT_2;
use std::io::{self, Read};

/// Bytes of the header up to version 3, with which that of version 4 begins.
const HEADER: usize = 16;
/// No scene compresses so well; beyond it a file is not unpacked.
const MOST_RATIO: u64 = 200;
/// Files of any length may hold so many bytes.
const SMALL: u64 = 1 << 16;
/// Memory of a decoder of Zstandard beside what it gives, which every decoder should have.
const WINDOW: u64 = 8 << 20;
/// The flag of files with extensions between header and table.
const EXTENDED: u8 = 2;
/// The extension that names axes by a number; 0 says nothing.
const AXES: u32 = 0xADBE_0003;
/// The axes of files without it.
const USUAL_AXES: u32 = 4;
/// What messages call the fields.
const FIELDS: [&str; 6] = ["positions", "opacities", "colours", "scales", "rotations", "harmonics"];

/// What the header says.
struct Header {
    version: u32,
    count: usize,
    degree: u32,
    fractional_bits: u32,
    antialiased: bool,
}

impl Header {
    fn read(bytes: &[u8; HEADER]) -> Result<Self, String> {
        let [version, count] = [word(bytes, 4), word(bytes, 8)].map(Option::unwrap_or_default);
        if !(2..=4).contains(&version) {
            return Err(format!("it has version {version} of the format; versions 2 to 4 are read"));
        }
        let [degree, fractional_bits] = [bytes[12], bytes[13]].map(u32::from);
        if degree > MAX_SH_DEGREE {
            return Err(format!("its spherical harmonics have degree {degree}; degrees 0 to {MAX_SH_DEGREE} are read"));
        }
        if fractional_bits > 24 {
            return Err(format!("its coordinates have {fractional_bits} bits behind the point where 24 are all"));
        }
        let antialiased = bytes[14] & ANTIALIASED != 0;
        Ok(Self { version, count: count as usize, degree, fractional_bits, antialiased })
    }

    fn rotation_bytes(&self) -> usize {
        if self.version == 2 { 3 } else { 4 }
    }

    /// Bytes of each Gaussian by field, in the order of the file.
    fn row(&self) -> [usize; 6] {
        [9, 1, 3, 3, self.rotation_bytes(), 3 * (coefficients(self.degree) - 1)]
    }

    /// Bytes of all fields.
    ///
    /// # Errors
    /// They are more than a file of this length can hold.
    fn needed(&self, length: usize) -> Result<u64, String> {
        let needed = self.count as u64 * self.row().iter().sum::<usize>() as u64;
        match needed > SMALL.max(MOST_RATIO * length as u64) {
            true => Err(format!("it promises {} Gaussians, more than its {length} bytes can hold", self.count)),
            false => Ok(needed),
        }
    }
}

/// A little-endian number of a file.
fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

/// Reads versions 2 to 4.
///
/// # Errors
/// What is wrong.
pub(super) fn read(bytes: &[u8]) -> Result<Gaussians, String> {
    if bytes.starts_with(MAGIC) { read_frames(bytes) } else { read_gzip(bytes) }
}

fn read_gzip(bytes: &[u8]) -> Result<Gaussians, String> {
    let damaged = |error: io::Error| format!("its gzip stream is damaged ({error})");
    let mut gzip = GzDecoder::new(bytes);
    let mut header = [0; HEADER];
    gzip.read_exact(&mut header).map_err(damaged)?;
    if !header.starts_with(MAGIC) {
        return Err("what its gzip stream holds does not begin with `NGSP`".to_owned());
    }
    let header = Header::read(&header)?;
    if header.version > 3 {
        return Err(format!("it is one gzip stream, which version {} is not", header.version));
    }
    let needed = header.needed(bytes.len())?;
    let mut data = Vec::new();
    gzip.by_ref().take(needed).read_to_end(&mut data).map_err(damaged)?;
    if (data.len() as u64) < needed {
        return Err(format!("it is truncated: it promises {} Gaussians and ends before", header.count));
    }
    // Extensions may follow. The checksum behind them shows damage.
    io::copy(&mut gzip.take(SMALL), &mut io::sink()).map_err(damaged)?;
    let mut rest = data.as_slice();
    let fields = header.row().map(|row| {
        let (field, behind) = rest.split_at(row * header.count);
        rest = behind;
        field
    });
    Ok(unpack(&header, fields))
}

/// Reads version 4: a Zstandard frame for each field.
fn read_frames(bytes: &[u8]) -> Result<Gaussians, String> {
    let truncated = || "it is truncated: it ends before its last field".to_owned();
    let header = Header::read(bytes.first_chunk().ok_or_else(truncated)?)?;
    if header.version < 4 {
        return Err(format!(
            "it has version {} of the format, which is one gzip stream, and it is none",
            header.version
        ));
    }
    header.needed(bytes.len())?;
    let table = word(bytes, HEADER).ok_or_else(truncated)? as usize;
    if table < HEADER_4 {
        return Err(format!("its table of fields begins at byte {table}, within its header"));
    }
    if bytes[14] & EXTENDED != 0 {
        check_extensions(bytes.get(HEADER_4..table).ok_or_else(truncated)?)?;
    }
    let fields = usize::from(bytes[15]);
    let mut lengths = bytes.get(table..).and_then(|rest| rest.get(..TABLE_ROW * fields)).ok_or_else(truncated)?;
    let mut streams = &bytes[table + lengths.len()..];
    let mut found: [Vec<u8>; 6] = Default::default();
    for ((row, field), name) in header.row().into_iter().zip(&mut found).zip(FIELDS) {
        if row == 0 {
            continue;
        }
        let Some((length, behind)) = lengths.split_at_checked(TABLE_ROW) else {
            return Err(format!("it lacks the field of its {name}"));
        };
        lengths = behind;
        let length = length.first_chunk().map_or(u64::MAX, |length| u64::from_le_bytes(*length));
        let cut = usize::try_from(length).ok().and_then(|length| streams.split_at_checked(length));
        let (stream, behind) = cut.ok_or_else(truncated)?;
        streams = behind;
        *field = frame(stream, row * header.count).map_err(|reason| format!("the field of its {name} {reason}"))?;
    }
    Ok(unpack(&header, found.each_ref().map(Vec::as_slice)))
}

/// Refuses other axes than those of the format.
fn check_extensions(mut records: &[u8]) -> Result<(), String> {
    while let (Some(kind), Some(length)) = (word(records, 0), word(records, 4)) {
        let axes = word(records, 8).filter(|&axes| kind == AXES && axes != 0 && axes != USUAL_AXES);
        if let Some(axes) = axes {
            return Err(format!(
                "its extension `SPZ_ADOBE_coordinate_system` asks for the axes {axes}, which are not read"
            ));
        }
        records = records[8..].get(length as usize..).ok_or("one of its extensions reaches behind their end")?;
    }
    Ok(())
}

/// The `length` bytes that a Zstandard frame holds.
fn frame(stream: &[u8], length: usize) -> Result<Vec<u8>, String> {
    let damaged = |error: &dyn std::fmt::Display| format!("is damaged ({error})");
    let window = WINDOW.max(length as u64);
    let mut decoder = StreamingDecoder::new_with_max_window_size(stream, window).map_err(|error| damaged(&error))?;
    let mut data = Vec::new();
    decoder.by_ref().take(length as u64 + 1).read_to_end(&mut data).map_err(|error| damaged(&error))?;
    if data.len() != length {
        let found = if data.len() < length { data.len().to_string() } else { "more".to_owned() };
        return Err(format!("holds {found} bytes where {length} are needed"));
    }
    let said = decoder.decoder.get_checksum_from_data();
    if said.is_some() && said != decoder.decoder.get_calculated_checksum() {
        return Err(damaged(&"its checksum differs"));
    }
    Ok(data)
}

/// The Gaussians in fields of the lengths that the header promises.
fn unpack(header: &Header, fields: [&[u8]; 6]) -> Gaussians {
    let [positions, opacities, colors, scales, rotations, harmonics] = fields;
    let mut g = Gaussians::with_capacity(header.count, header.degree);
    g.antialiased = header.antialiased;
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

fn unpack_rotation(packed: u32) -> [f32; 4] {
    let component = |shift: u32| {
        let bits = packed >> shift & 0x3ff;
        let magnitude = f64::from(bits & 0x1ff) / ROTATION_STEPS * FRAC_1_SQRT_2;
        if bits >> 9 == 1 { -magnitude } else { magnitude }
    };
    let others = [component(20), component(10), component(0)];
    quantise::scalar_first(quantise::from_smallest_three((packed >> 30) as usize, others))
}

/// The quaternion of version 2: x, y, z, and a w that is not negative.
fn first_three(bytes: [u8; 3]) -> [f32; 4] {
    let [x, y, z] = bytes.map(|v| f64::from(v) / 127.5 - 1.0);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    [w, x, y, z].map(|v| v as f32)
}
