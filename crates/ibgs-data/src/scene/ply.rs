//! PLY files of Gaussians: the field order of 3D Gaussian splatting with the plane offset `nd` after the normal.
//!
//! A file is in scene units. Where float32 cannot hold the scene's coordinates, they are relative to an offset in the header
//! ([`Gaussians::file_offset`]).
//!
//! Reading is serde-ply's (any scalar type, both byte orders, text). Writing is a header and rows of floats, done here:
//! that crate spells the type `float32`, which common viewers do not know, and has no header for zero rows.

use super::formats::compressed_ply;
use super::gaussians::{Carry, coefficients};
use super::ply_rows::{ElementSeed, Layout, RowSink, Rows};
use super::{Gaussians, SceneError, tags};
use crate::dataset::Point;
use crate::files;
use crate::local_space::LocalSpace;
use crate::ply_offset;
use serde::de::MapAccess;
use serde_ply::{DeserializeError, ElementDef, PlyFormat, PlyHeader, PlyReader, PropertyType, ScalarType};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, Write};
use std::path::Path;

/// Which fields a written PLY has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlyFlavor {
    /// Everything: `x y z nx ny nz nd f_dc_0..2 f_rest_0.. opacity scale_0..2 rot_0..3`.
    Full,
    /// Without `nd`: the layout of 3D Gaussian splatting that other viewers open.
    Plain,
}

/// Writes Gaussians as a binary little-endian PLY of 32-bit floats, in scene units, in one atomic step.
///
/// # Errors
/// Those of [`Gaussians::validate`] (nothing is written then) and [`SceneError::Write`].
pub fn write_ply(path: &Path, gaussians: &Gaussians, flavor: PlyFlavor) -> Result<(), SceneError> {
    gaussians.validate()?;
    files::write_atomically(path, |out| write_ply_to(out, gaussians, flavor))?;
    Ok(())
}

/// Writes the bytes of a PLY file of valid Gaussians.
pub fn write_ply_to(out: &mut dyn Write, gaussians: &Gaussians, flavor: PlyFlavor) -> io::Result<()> {
    let fields = field_names(gaussians.sh_degree, flavor);
    let floats = fields.iter().map(|name| ("float", name.as_str()));
    let offset = gaussians.file_offset();
    let comments = format!("{}{}", ply_offset::line(offset), tags::line(gaussians.antialiased));
    write_header(out, gaussians.len(), &comments, floats)?;
    let carry = Carry::new(gaussians.space, LocalSpace::at(offset.unwrap_or_default()));
    let mut row = Vec::with_capacity(4 * fields.len());
    for index in 0..gaussians.len() {
        row.clear();
        push_row(gaussians, index, (&carry, flavor), &mut |v| row.extend(v.to_le_bytes()));
        out.write_all(&row)?;
    }
    Ok(())
}

/// Writes the initial points as `input.ply`: float positions, zero normals, 8-bit colours, little endian. Far from the origin
/// `space` gives the offset.
///
/// # Errors
/// [`SceneError::Write`].
pub fn write_points_ply(path: &Path, points: &[Point], space: LocalSpace) -> Result<(), SceneError> {
    let floats = ["x", "y", "z", "nx", "ny", "nz"].map(|name| ("float", name));
    let bytes = ["red", "green", "blue"].map(|name| ("uchar", name));
    let offset = space.file_offset();
    files::write_atomically(path, |out| {
        write_header(out, points.len(), &ply_offset::line(offset), floats.into_iter().chain(bytes))?;
        for point in points {
            for v in (point.position - offset.unwrap_or_default()).as_vec3().to_array() {
                out.write_all(&v.to_le_bytes())?;
            }
            out.write_all(&[0; 12])?;
            out.write_all(&point.color)?;
        }
        Ok(())
    })?;
    Ok(())
}

fn write_header<'a>(
    out: &mut dyn Write,
    rows: usize,
    comments: &str,
    fields: impl Iterator<Item = (&'a str, &'a str)>,
) -> io::Result<()> {
    write!(out, "ply\nformat binary_little_endian 1.0\n{comments}element vertex {rows}\n")?;
    for (kind, name) in fields {
        writeln!(out, "property {kind} {name}")?;
    }
    out.write_all(b"end_header\n")
}

/// Field names in file order.
fn field_names(sh_degree: u32, flavor: PlyFlavor) -> Vec<String> {
    let numbered = |name: &'static str, n: usize| (0..n).map(move |i| format!("{name}_{i}"));
    let mut names: Vec<String> = ["x", "y", "z", "nx", "ny", "nz"].map(String::from).into();
    if flavor == PlyFlavor::Full {
        names.push("nd".to_owned());
    }
    names.extend(numbered("f_dc", 3));
    names.extend(numbered("f_rest", 3 * (coefficients(sh_degree) - 1)));
    names.push("opacity".to_owned());
    names.extend(numbered("scale", 3));
    names.extend(numbered("rot", 4));
    names
}

/// Passes the values of one Gaussian to `push` in the order of [`field_names`].
fn push_row(g: &Gaussians, index: usize, (carry, flavor): (&Carry, PlyFlavor), push: &mut impl FnMut(f32)) {
    let c = g.sh_coefficients();
    let sh = &g.sh[index * 3 * c..(index + 1) * 3 * c];
    carry.mean(g.means[index]).into_iter().for_each(&mut *push);
    g.normals[index].iter().for_each(|&v| push(v));
    if flavor == PlyFlavor::Full {
        push(carry.offset(g.offsets[index]));
    }
    sh[..3].iter().for_each(|&v| push(v));
    // In the file the rest is channel-major, in memory coefficient-major.
    for channel in 0..3 {
        (1..c).for_each(|k| push(sh[3 * k + channel]));
    }
    push(g.opacity_logits[index]);
    g.log_scales[index].iter().for_each(|&v| push(carry.log_scale(v)));
    g.rotations[index].iter().for_each(|&v| push(v));
}

/// Reads Gaussians from a PLY file. Fields are found by name, in any order and of any scalar type; unknown ones are
/// ignored; a missing `nd` is 0. Without `nd`, missing or zero normals become (0, 0, 1);
/// `red green blue` may stand for `f_dc`. They come in scene units, around the
/// offset of the header; positions of double precision that no float holds, around their middle. Gaussians with NaN or
/// infinity, or with a quaternion of zeros, are left out, with a warning in the log; but an infinite logit is opaque or
/// transparent, and the logarithm of a scale may be that of 0. Compressed PLYs are read too ([`Format`](super::Format)).
///
/// # Errors
/// A [`SceneError`] that names the file and, where there is one, the field: not a PLY, missing field, list in place of
/// a number, impossible number of `f_rest` fields, less or more data than the header promises, nothing finite.
pub fn read_ply(path: &Path) -> Result<Gaussians, SceneError> {
    let (mut file, length) = open(path)?;
    read_ply_from(&mut file, length, path)
}

/// Opens a file to read Gaussians from, with its length in bytes.
pub(super) fn open(path: &Path) -> Result<(BufReader<File>, u64), SceneError> {
    let open = || -> io::Result<(File, u64)> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        Ok((file, length))
    };
    let (file, length) = open().map_err(|source| read_error(path, source))?;
    Ok((BufReader::with_capacity(1 << 20, file), length))
}

pub(super) fn read_error(path: &Path, source: io::Error) -> SceneError {
    SceneError::Read { path: path.to_owned(), source }
}

fn bad_ply(path: &Path, reason: impl Into<String>) -> SceneError {
    SceneError::BadPly { path: path.to_owned(), reason: reason.into() }
}

/// [`read_ply`] from anything seekable that is `length` bytes long; `path` is for messages.
///
/// # Errors
/// As [`read_ply`].
pub fn read_ply_from<R: BufRead + Seek>(reader: &mut R, length: u64, path: &Path) -> Result<Gaussians, SceneError> {
    let io_error = |source| read_error(path, source);
    let mut magic = Vec::new();
    reader.take(3).read_to_end(&mut magic).map_err(io_error)?;
    if magic != b"ply" {
        return Err(bad_ply(path, "it does not begin with `ply`"));
    }
    reader.rewind().map_err(io_error)?;
    let header = PlyReader::from_reader(&mut *reader)
        .map_err(|error| bad_ply(path, format!("its header is damaged ({})", error.0)))?
        .header()
        .clone();
    let header_length = reader.stream_position().map_err(io_error)?;
    let is_compressed = compressed_ply::is_compressed(&header);
    let last = if is_compressed { header.elem_defs.last() } else { header.get_element("vertex") };
    let last = last.ok_or_else(|| bad_ply(path, "it has no `vertex` element"))?;
    check_header(&header, last, length.saturating_sub(header_length), path)?;
    let layout = if is_compressed { None } else { Some(Layout::new(last, path)?) };

    reader.rewind().map_err(io_error)?;
    let mut text = Vec::new();
    reader.take(header_length).read_to_end(&mut text).map_err(io_error)?;
    let offset = ply_offset::find(&text).map_err(|reason| bad_ply(path, reason))?;
    reader.rewind().map_err(io_error)?;
    // The last number of a text file need not be followed by a line break; serde-ply wants one.
    let end = if header.format == PlyFormat::Ascii { &b"\n"[..] } else { &[] };
    let data = Read::chain(&mut *reader, end);
    let mut gaussians = match &layout {
        None => compressed_ply::read(data, &header, offset, path)?,
        Some(layout) => {
            let mut rows = Rows::new(layout, last);
            read_vertices(data, &mut rows).map_err(|error| rows_error(&error, last.count, rows.read(), path))?;
            rows.around(offset, path)?
        }
    };
    gaussians.antialiased = tags::find(&text);
    if header.elem_defs.last().is_some_and(|element| element.name == last.name) {
        check_rest(reader, length, &header, path)?;
    }
    Ok(gaussians)
}

/// Why the rows of Gaussians could not be read after `found` of them.
pub(super) fn rows_error(error: &DeserializeError, promised: usize, found: usize, path: &Path) -> SceneError {
    match error.0.kind() {
        io::ErrorKind::UnexpectedEof => {
            SceneError::Truncated { path: path.to_owned(), promised: promised as u64, found: found as u64 }
        }
        _ => bad_ply(path, format!("Gaussian {found} cannot be read ({})", error.0)),
    }
}

/// Compares all counts up to the element `last` with the bytes there are, before anything is reserved.
fn check_header(header: &PlyHeader, last: &ElementDef, data_length: u64, path: &Path) -> Result<(), SceneError> {
    let mut needed: u128 = 0;
    for element in &header.elem_defs {
        let row = min_row_bytes(element, header.format);
        if row == 0 && element.count > 0 {
            let reason = format!("its element `{}` has no fields", element.name);
            return Err(bad_ply(path, reason));
        }
        let before = needed;
        needed += element.count as u128 * row as u128;
        // The line break after the last value of a text file may be missing.
        if needed > u128::from(data_length) + 1 || before > u128::from(data_length) {
            return Err(SceneError::Truncated {
                path: path.to_owned(),
                promised: header.get_element("vertex").map_or(0, |v| v.count as u64),
                found: if element.name == "vertex" {
                    (u128::from(data_length).saturating_sub(before) / row as u128) as u64
                } else {
                    0
                },
            });
        }
        if element.name == last.name {
            break;
        }
    }
    Ok(())
}

/// Least number of bytes of one row: exact for binary rows without lists.
fn min_row_bytes(element: &ElementDef, format: PlyFormat) -> usize {
    let bytes = |kind: ScalarType| match (format, kind) {
        (PlyFormat::Ascii, _) => 2,
        (_, ScalarType::I8 | ScalarType::U8) => 1,
        (_, ScalarType::I16 | ScalarType::U16) => 2,
        (_, ScalarType::I32 | ScalarType::U32 | ScalarType::F32) => 4,
        (_, ScalarType::F64) => 8,
    };
    let field = |kind: &PropertyType| match *kind {
        PropertyType::Scalar(kind) => bytes(kind),
        PropertyType::List { count_type, .. } => bytes(count_type),
    };
    element.properties.iter().map(|p| field(&p.property_type)).sum()
}

/// Refuses a header that counts fewer rows than the data holds; a few stray bytes at the end are harmless.
fn check_rest<R: BufRead + Seek>(
    reader: &mut R,
    length: u64,
    header: &PlyHeader,
    path: &Path,
) -> Result<(), SceneError> {
    let io_error = |source| read_error(path, source);
    let rest = length.saturating_sub(reader.stream_position().map_err(io_error)?);
    let harmless = if header.format == PlyFormat::Ascii {
        reader.bytes().all(|byte| byte.is_ok_and(|b| b.is_ascii_whitespace()))
    } else {
        let row = header.elem_defs.last().map_or(1, |last| min_row_bytes(last, header.format));
        rest < row as u64
    };
    if harmless {
        return Ok(());
    }
    Err(bad_ply(
        path,
        format!("{rest} bytes follow the last Gaussian that its header counts; the count is wrong or the file damaged"),
    ))
}

/// Skips the elements before `vertex` and reads that one.
fn read_vertices<R: BufRead>(reader: R, rows: &mut Rows<'_>) -> Result<(), DeserializeError> {
    let mut ply = PlyReader::from_reader(reader)?;
    while let Some(element) = ply.current_element() {
        let is_vertex = element.name == "vertex";
        let sink = if is_vertex { Some(&mut *rows as &mut dyn RowSink) } else { None };
        MapAccess::next_value_seed(&mut &mut ply, ElementSeed(sink))?;
        if is_vertex {
            break;
        }
    }
    Ok(())
}
