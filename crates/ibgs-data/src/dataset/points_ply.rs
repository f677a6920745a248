//! Points of a PLY file: ASCII or binary (both byte orders), `x y z` and optional `red green blue` (also `diffuse_red ..`, or
//! floats up to 1 or 255), or the constant coefficients `f_dc_0 ..` of Gaussians, relative to the offset that the header may give. Normals and all other fields are skipped.

use super::Point;
use super::error::{DatasetError, without_mark};
use crate::{ply_color, ply_offset};
use glam::DVec3;
use std::f64::consts::FRAC_2_SQRT_PI;
use std::path::Path;

/// Constant basis function of the spherical harmonics.
const SH_C0: f64 = FRAC_2_SQRT_PI / 4.0;

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// A scalar type of the PLY format.
#[derive(Clone, Copy, PartialEq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Scalar> {
        Some(match name {
            "char" | "int8" => Scalar::I8,
            "uchar" | "uint8" => Scalar::U8,
            "short" | "int16" => Scalar::I16,
            "ushort" | "uint16" => Scalar::U16,
            "int" | "int32" => Scalar::I32,
            "uint" | "uint32" => Scalar::U32,
            "float" | "float32" => Scalar::F32,
            "double" | "float64" => Scalar::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }

    /// The value at the start of `bytes`; none where they end too early.
    fn read(self, bytes: &[u8], format: Format) -> Option<f64> {
        let mut raw = [0_u8; 8];
        let size = self.size();
        raw[..size].copy_from_slice(bytes.get(..size)?);
        if format == Format::BigEndian {
            raw[..size].reverse();
        }
        let [a, b, c, d, ..] = raw;
        Some(match self {
            Scalar::I8 => f64::from(a as i8),
            Scalar::U8 => f64::from(a),
            Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
            Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
            Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Scalar::F64 => f64::from_le_bytes(raw),
        })
    }
}

/// The header up to the end of the vertex element, which has to come first.
struct Header {
    format: Format,
    count: u64,
    properties: Vec<(String, Scalar)>,
    /// What the positions are relative to.
    offset: DVec3,
    /// Offset of the first byte of data, and the number of header lines.
    data: usize,
    lines: usize,
}

/// Where the wanted values are among the properties.
struct Columns {
    position: [usize; 3],
    color: Option<[usize; 3]>,
    kind: ColorKind,
}

/// What the numbers of a colour are.
#[derive(Clone, Copy, PartialEq)]
enum ColorKind {
    /// Constant coefficients of Gaussians.
    Coefficients,
    /// Whole numbers of 8 bits, which white has all.
    Bytes,
    /// Of 16 bits.
    Words,
    /// Up to the number that the largest says.
    Floats,
}

impl ColorKind {
    /// Brings a colour to 0..255: factor, then summand.
    fn scale(self, largest: f64) -> [f64; 2] {
        match self {
            Self::Coefficients => [255.0 * SH_C0, 127.5],
            Self::Bytes => [1.0, 0.0],
            Self::Words => [1.0 / 257.0, 0.0],
            Self::Floats => [255.0 / ply_color::white_of_floats(largest), 0.0],
        }
    }
}

/// The points of a file.
pub(crate) struct Cloud {
    pub points: Vec<Point>,
    /// Whether the file has colours; without them points are grey.
    pub has_colors: bool,
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<Header, String> {
        let mut header =
            Header { format: Format::Ascii, count: 0, properties: Vec::new(), offset: DVec3::ZERO, data: 0, lines: 0 };
        let (mut element, mut format_seen) = (String::new(), false);
        loop {
            let rest = bytes.get(header.data..).unwrap_or_default();
            let Some(length) = rest.iter().position(|byte| *byte == b'\n') else {
                return Err("the header has no end_header line".to_owned());
            };
            header.data += length + 1;
            header.lines += 1;
            let number = header.lines;
            let line = String::from_utf8_lossy(&rest[..length]);
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["ply"] if number == 1 => {}
                _ if number == 1 => return Err("the first line is not `ply`".to_owned()),
                ["end_header"] if format_seen && !header.properties.is_empty() => {
                    return Ok(header);
                }
                ["end_header"] => {
                    return Err("the header lacks its format or the vertex element".to_owned());
                }
                ["format", name, _] => {
                    format_seen = true;
                    header.format = format(name).ok_or(format!("line {number}: unknown format `{name}`"))?;
                }
                ["element", name, count] => {
                    if *name != "vertex" && header.properties.is_empty() {
                        return Err(format!("line {number}: `{name}` comes before the vertex element"));
                    }
                    if *name == "vertex" {
                        header.count = count.parse().map_err(|_| format!("line {number}: `{count}` is no count"))?;
                    }
                    element = (*name).to_owned();
                }
                ["property", kind, name] if element == "vertex" => {
                    let scalar = Scalar::parse(kind).ok_or(format!("line {number}: unknown type `{kind}`"))?;
                    header.properties.push(((*name).to_owned(), scalar));
                }
                ["comment", ..] => header.offset = ply_offset::parse(&line)?.unwrap_or(header.offset),
                ["property", ..] if element == "vertex" => {
                    return Err(format!("line {number}: list properties of vertices are not supported"));
                }
                _ => {}
            }
        }
    }

    fn columns(&self) -> Result<Columns, String> {
        let find = |name: &str| self.properties.iter().position(|property| property.0 == name);
        let need = |name: &str| find(name).ok_or(format!("vertex property {name} is missing"));
        let position = [need("x")?, need("y")?, need("z")?];
        let all = |names: [&str; 3]| {
            let [a, b, c] = names.map(find);
            Some([a?, b?, c?])
        };
        let own = ply_color::NAMES.into_iter().find_map(all);
        let color = own.or_else(|| all(["f_dc_0", "f_dc_1", "f_dc_2"]));
        let kind = match own.map(|[first, ..]| self.properties[first].1) {
            None => ColorKind::Coefficients,
            Some(Scalar::F32 | Scalar::F64) => ColorKind::Floats,
            Some(Scalar::U16) => ColorKind::Words,
            Some(_) => ColorKind::Bytes,
        };
        Ok(Columns { position, color, kind })
    }
}

fn format(name: &str) -> Option<Format> {
    match name {
        "ascii" => Some(Format::Ascii),
        "binary_little_endian" => Some(Format::LittleEndian),
        "binary_big_endian" => Some(Format::BigEndian),
        _ => None,
    }
}

impl Columns {
    /// Position and colour of a vertex, as the file has them.
    fn vertex(&self, values: &[f64]) -> Vertex {
        let color = self.color.map_or([0.0; 3], |columns| columns.map(|column| values[column]));
        (DVec3::from_array(self.position.map(|column| values[column])), color)
    }

    /// The points of vertices; mid-grey where the file has no colours.
    fn points(&self, vertices: &[Vertex], offset: DVec3) -> Vec<Point> {
        let largest = vertices.iter().flat_map(|(_, color)| color).copied().fold(0.0, f64::max);
        let [factor, summand] = self.kind.scale(largest);
        let level = |value: f64| (value * factor + summand).round() as u8;
        let color = |color: [f64; 3]| if self.color.is_some() { color.map(level) } else { [128; 3] };
        vertices.iter().map(|&(place, rgb)| Point { position: place + offset, color: color(rgb) }).collect()
    }
}

/// Position and colour.
type Vertex = (DVec3, [f64; 3]);

/// The points in the contents of a PLY file.
pub(crate) fn read(path: &Path, bytes: &[u8]) -> Result<Cloud, DatasetError> {
    parse(without_mark(bytes)).map_err(|problem| DatasetError::Ply { path: path.to_owned(), problem })
}

fn parse(bytes: &[u8]) -> Result<Cloud, String> {
    let header = Header::parse(bytes)?;
    let columns = header.columns()?;
    let data = bytes.get(header.data..).unwrap_or_default();
    let vertices = match header.format {
        Format::Ascii => parse_ascii(&header, &columns, data),
        _ => parse_binary(&header, &columns, data),
    }?;
    Ok(Cloud { points: columns.points(&vertices, header.offset), has_colors: columns.color.is_some() })
}

fn parse_ascii(header: &Header, columns: &Columns, data: &[u8]) -> Result<Vec<Vertex>, String> {
    let text = std::str::from_utf8(data).map_err(|_| "the text is not UTF-8".to_owned())?;
    let mut lines = (header.lines + 1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let mut vertices = Vec::new();
    let mut values = Vec::new();
    for index in 0..header.count {
        let Some((number, line)) = lines.next() else {
            return Err(format!("the header claims {} vertices, the file has {index}", header.count));
        };
        values.clear();
        for (word, (name, _)) in line.split_whitespace().zip(&header.properties) {
            let value: f64 = word.parse().map_err(|_| format!("line {number}: {name} `{word}` is not a number"))?;
            values.push(value);
        }
        if values.len() < header.properties.len() {
            return Err(format!("line {number}: {} values where {} are needed", values.len(), header.properties.len()));
        }
        vertices.push(columns.vertex(&values));
    }
    Ok(vertices)
}

fn parse_binary(header: &Header, columns: &Columns, data: &[u8]) -> Result<Vec<Vertex>, String> {
    let stride: usize = header.properties.iter().map(|(_, scalar)| scalar.size()).sum();
    let room = data.len() / stride.max(1);
    if header.count > room as u64 {
        return Err(format!(
            "the header claims {} vertices, the {} bytes after it hold {room}",
            header.count,
            data.len()
        ));
    }
    let vertex = |bytes: &[u8]| -> Option<Vertex> {
        let mut at = 0;
        let mut values = Vec::with_capacity(header.properties.len());
        for (_, scalar) in &header.properties {
            values.push(scalar.read(bytes.get(at..)?, header.format)?);
            at += scalar.size();
        }
        Some(columns.vertex(&values))
    };
    let vertices: Option<Vec<Vertex>> = data.chunks_exact(stride).take(header.count as usize).map(vertex).collect();
    vertices.ok_or_else(|| "a vertex ends early".to_owned())
}
