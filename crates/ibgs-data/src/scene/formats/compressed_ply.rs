//! The compressed PLY of PlayCanvas and SuperSplat.
//!
//! The element `chunk` has the bounds of 256 Gaussians each: positions, logarithms of scales, colours of degree 0. In the
//! element `vertex` a Gaussian is four words: position and scale as 11, 10 and 11 bits between the bounds, the smallest three
//! components of the quaternion as 10 bits each behind two for the largest one, colours between the bounds and opacity as
//! bytes. The element `sh` has a byte for each higher coefficient, over -4 to 4. Axes are those of 3DGS.

use super::super::gaussians::degree_of;
use super::super::ply::rows_error;
use super::super::ply_rows::{ElementSeed, RowSink, scalar_columns};
use super::super::{Gaussians, SceneError, tags};
use super::{MAX_SH_DEGREE, Steps, Writing, axes, finite, order, quantise, without_planes};
use crate::local_space::LocalSpace;
use crate::ply_offset;
use glam::DVec3;
use serde::de::MapAccess;
use serde_ply::{DeserializeError, ElementDef, PlyHeader, PlyReader, PropertyType, ScalarType};
use std::f64::consts::SQRT_2;
use std::io::{self, BufRead, Write};
use std::path::Path;

pub(super) const ROW: super::Row = super::Row {
    name: "compressed PLY (SuperSplat)",
    ending: ".compressed.ply",
    marks: &[],
    axes: axes::RDF,
    max_sh_degree: MAX_SH_DEGREE,
    steps: Steps { rotation: SQRT_2 / ROTATION_STEPS as f64, sh: [0.0, HARMONIC, HARMONIC, HARMONIC] },
    position_step: None,
    keeps_antialiased: true,
    place_of_offset: super::PLY.place_of_offset,
    writing: Writing::By(|g| Ok(Box::new(move |out| write(g, out)))),
    read: super::PLY.read,
};

/// Gaussians of a chunk.
const CHUNK: usize = 256;
/// Fields of a chunk: the least and the largest of three positions, three scales and three colours.
const BOUNDS: [&str; 18] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
    "min_r",
    "min_g",
    "min_b",
    "max_r",
    "max_g",
    "max_b",
];
/// Files of older programs lack the bounds of the colours: they are 0 and 1.
const BOUNDS_WITHOUT_COLOR: usize = 12;
const WORDS: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];
/// Largest higher coefficient.
const MOST_HARMONIC: f64 = 4.0;
/// Step of higher coefficients.
const HARMONIC: f64 = 2.0 * MOST_HARMONIC / 256.0;
/// Steps of a component of a rotation.
const ROTATION_STEPS: u32 = 1023;
/// Largest range of the logarithms of scales in a chunk; smaller scales become the least.
const MOST_LOGARITHMS: f32 = 20.0;

/// Writes the Gaussians in an order in which neighbours share a chunk.
fn write(g: &Gaussians, out: &mut dyn Write) -> io::Result<()> {
    let higher = 3 * (g.sh_coefficients() - 1);
    let comments = format!("{}{}", ply_offset::line(g.space.file_offset()), tags::line(g.antialiased));
    let (chunks, count) = (g.len().div_ceil(CHUNK), g.len());
    write!(out, "ply\nformat binary_little_endian 1.0\n{comments}element chunk {chunks}\n")?;
    BOUNDS.iter().try_for_each(|name| writeln!(out, "property float {name}"))?;
    writeln!(out, "element vertex {count}")?;
    WORDS.iter().try_for_each(|name| writeln!(out, "property uint {name}"))?;
    if higher > 0 {
        writeln!(out, "element sh {count}")?;
        (0..higher).try_for_each(|i| writeln!(out, "property uchar f_rest_{i}"))?;
    }
    out.write_all(b"end_header\n")?;
    let order = order::morton(g);
    let mut words = Vec::with_capacity(16 * count);
    for chunk in order.chunks(CHUNK) {
        let bounds = Bounds::of(g, chunk);
        bounds.values().iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
        for &index in chunk {
            bounds.pack(g, index).iter().for_each(|word| words.extend(word.to_le_bytes()));
        }
    }
    out.write_all(&words)?;
    let per_channel = higher / 3;
    let mut row = Vec::with_capacity(higher);
    for index in order {
        let sh = &g.sh[(higher + 3) * index..(higher + 3) * (index + 1)];
        row.clear();
        // The file has all coefficients of red, then of green, then of blue.
        row.extend((0..higher).map(|at| pack_harmonic(sh[3 * (at % per_channel + 1) + at / per_channel])));
        out.write_all(&row)?;
    }
    Ok(())
}

/// 256 equal parts of the range.
fn pack_harmonic(value: f32) -> u8 {
    ((f64::from(value) / (2.0 * MOST_HARMONIC) + 0.5) * 256.0).floor().clamp(0.0, 255.0) as u8
}

/// The middle of a part; the outermost stand for the ends of the range.
fn unpack_harmonic(byte: f64) -> f32 {
    let part = match byte {
        0.0 => 0.0,
        255.0 => 1.0,
        _ => (byte + 0.5) / 256.0,
    };
    ((part - 0.5) * 2.0 * MOST_HARMONIC) as f32
}

/// Least and largest positions, logarithms of scales and colours of a chunk, as three axes each.
#[derive(Clone, Copy)]
struct Bounds([[[f32; 3]; 2]; 3]);

impl Bounds {
    fn of(g: &Gaussians, chunk: &[usize]) -> Self {
        let mut bounds = [[[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]]; 3];
        for &index in chunk {
            for (values, [low, high]) in Self::parts(g, index).iter().zip(&mut bounds) {
                for axis in 0..3 {
                    low[axis] = low[axis].min(values[axis]);
                    high[axis] = high[axis].max(values[axis]);
                }
            }
        }
        // A flat Gaussian, whose scale has a logarithm far below all others, would leave no steps to them.
        let [low, high] = &mut bounds[1];
        low.iter_mut().zip(high).for_each(|(low, high)| *low = low.max(*high - MOST_LOGARITHMS));
        Self(bounds)
    }

    /// Position, logarithms of the scales and colour.
    fn parts(g: &Gaussians, index: usize) -> [[f32; 3]; 3] {
        let dc = 3 * g.sh_coefficients() * index;
        let color = [0, 1, 2].map(|channel| quantise::color(g.sh[dc + channel]) as f32);
        [g.means[index], g.log_scales[index], color]
    }

    /// In the order of [`BOUNDS`].
    fn values(&self) -> Vec<f32> {
        self.0.as_flattened().as_flattened().to_vec()
    }

    fn from_values(values: [f32; 18]) -> Self {
        let corner = |at: usize| {
            let mut corner = [values[at], values[at + 1], values[at + 2]];
            if (6..12).contains(&at) {
                finite::make_finite(&mut 0.0, &mut corner);
            }
            corner
        };
        Self([0, 6, 12].map(|at| [corner(at), corner(at + 3)]))
    }

    /// The four words of a Gaussian.
    fn pack(&self, g: &Gaussians, index: usize) -> [u32; 4] {
        let parts = Self::parts(g, index);
        let part = |which: usize, axis: usize, most: u32| {
            let [low, high] = self.0[which].map(|corner| f64::from(corner[axis]));
            let value = f64::from(parts[which][axis]);
            quantise::unit(if high > low { (value - low) / (high - low) } else { 0.0 }, most)
        };
        let eleven = |which: usize| part(which, 0, 2047) << 21 | part(which, 1, 1023) << 11 | part(which, 2, 2047);
        let color = [0, 1, 2].into_iter().fold(0, |word, axis| word << 8 | part(2, axis, 255));
        let opacity = u32::from(quantise::opacity_byte(g.opacity_logits[index]));
        [eleven(0), pack_rotation(g.rotations[index]), eleven(1), color << 8 | opacity]
    }

    /// A value between the bounds.
    fn at(&self, which: usize, axis: usize, part: f64) -> f64 {
        let [low, high] = self.0[which].map(|corner| f64::from(corner[axis]));
        low * (1.0 - part) + high * part
    }
}

fn pack_rotation(rotation: [f32; 4]) -> u32 {
    let (largest, others) = quantise::smallest_three(quantise::unit_quaternion(rotation));
    others.into_iter().fold(largest as u32, |word, v| word << 10 | quantise::unit(v / SQRT_2 + 0.5, ROTATION_STEPS))
}

fn unpack_rotation(word: u32) -> [f32; 4] {
    let component = |shift: u32| (f64::from(word >> shift & ROTATION_STEPS) / f64::from(ROTATION_STEPS) - 0.5) * SQRT_2;
    quantise::from_smallest_three((word >> 30) as usize, [component(20), component(10), component(0)])
}

/// Whether a header is that of a compressed PLY.
pub(in crate::scene) fn is_compressed(header: &PlyHeader) -> bool {
    let has_words = |vertex: &ElementDef| vertex.properties.iter().any(|p| p.name == WORDS[0]);
    header.get_element("chunk").is_some() && header.get_element("vertex").is_some_and(has_words)
}

/// Reads a compressed PLY from its beginning. The counts of the header were compared with the length of the file.
///
/// # Errors
/// As [`read_ply`](super::super::read_ply).
pub(in crate::scene) fn read<R: BufRead>(
    reader: R,
    header: &PlyHeader,
    offset: DVec3,
    path: &Path,
) -> Result<Gaussians, SceneError> {
    let mut unpacked = Unpacked::new(header, path)?;
    unpacked.read(reader).map_err(|error| rows_error(&error, unpacked.count, unpacked.gaussians.len(), path))?;
    let mut gaussians = unpacked.gaussians;
    if gaussians.sh_degree == 0 {
        gaussians.sh = unpacked.colors.into_flattened();
    }
    gaussians.space = LocalSpace::at(offset);
    without_planes(gaussians, path)
}

/// What a row is.
#[derive(Clone, Copy)]
enum Part {
    Chunk,
    Vertex,
    Harmonics,
}

/// Takes the rows of the three elements one after the other.
struct Unpacked {
    count: usize,
    chunk_columns: Vec<usize>,
    word_columns: [usize; 4],
    /// In the order of memory: coefficient, then channel.
    harmonic_columns: Vec<usize>,
    part: Part,
    row: Vec<f64>,
    chunks: Vec<Bounds>,
    colors: Vec<[f32; 3]>,
    gaussians: Gaussians,
}

impl Unpacked {
    fn new(header: &PlyHeader, path: &Path) -> Result<Self, SceneError> {
        let bad = |reason: String| SceneError::BadPly { path: path.to_owned(), reason };
        let element = |name: &str| header.get_element(name).ok_or_else(|| bad(format!("it has no `{name}` element")));
        let (chunk, vertex) = (element("chunk")?, element("vertex")?);
        let sh = header.get_element("sh");
        let names: Vec<&str> = header.elem_defs.iter().map(|e| e.name.as_str()).collect();
        if !matches!(names.as_slice(), ["chunk", "vertex"] | ["chunk", "vertex", "sh"]) {
            return Err(bad(format!(
                "it has the elements {} where a compressed PLY has chunk, vertex, sh",
                names.join(", ")
            )));
        }
        if chunk.count.saturating_mul(CHUNK) < vertex.count || sh.is_some_and(|sh| sh.count != vertex.count) {
            return Err(bad("the counts of its elements do not fit each other".to_owned()));
        }
        let columns = |element: &ElementDef, names: &[&str]| -> Result<Vec<usize>, SceneError> {
            let columns = scalar_columns(element, path)?;
            let missing = |name: &str| SceneError::MissingField { path: path.to_owned(), field: name.to_owned() };
            names.iter().map(|&name| columns.get(name).copied().ok_or_else(|| missing(name))).collect()
        };
        let word_columns = columns(vertex, &WORDS)?;
        let is_word = |&c: &usize| matches!(vertex.properties[c].property_type, PropertyType::Scalar(ScalarType::U32));
        if let Some(&column) = word_columns.iter().find(|c| !is_word(c)) {
            return Err(bad(format!("its field `{}` is no `uint`", vertex.properties[column].name)));
        }
        let has_colors = chunk.properties.iter().any(|p| p.name == BOUNDS[BOUNDS_WITHOUT_COLOR]);
        let bounds = if has_colors { &BOUNDS[..] } else { &BOUNDS[..BOUNDS_WITHOUT_COLOR] };
        let higher = sh.map_or(0, |sh| sh.properties.len());
        let degree = degree_of(higher)
            .ok_or_else(|| bad(format!("its element `sh` has {higher} fields where 9, 24 or 45 are needed")))?;
        let per_channel = higher / 3;
        let rest: Vec<String> = (0..higher).map(|i| format!("f_rest_{}", per_channel * (i % 3) + i / 3)).collect();
        let rest: Vec<&str> = rest.iter().map(String::as_str).collect();
        Ok(Self {
            count: vertex.count,
            chunk_columns: columns(chunk, bounds)?,
            word_columns: [word_columns[0], word_columns[1], word_columns[2], word_columns[3]],
            harmonic_columns: sh.map_or(Ok(Vec::new()), |sh| columns(sh, &rest))?,
            part: Part::Chunk,
            row: Vec::new(),
            chunks: Vec::with_capacity(chunk.count),
            colors: Vec::with_capacity(vertex.count),
            gaussians: Gaussians::with_capacity(vertex.count, degree),
        })
    }

    fn read<R: BufRead>(&mut self, reader: R) -> Result<(), DeserializeError> {
        let mut ply = PlyReader::from_reader(reader)?;
        while let Some(element) = ply.current_element() {
            self.row = vec![0.0; element.properties.len()];
            self.part = match element.name.as_str() {
                "chunk" => Part::Chunk,
                "vertex" => Part::Vertex,
                _ => Part::Harmonics,
            };
            MapAccess::next_value_seed(&mut &mut ply, ElementSeed(Some(self)))?;
        }
        Ok(())
    }

    fn finish_vertex(&mut self) {
        let [position, rotation, scale, color] = self.word_columns.map(|column| self.row[column] as u32);
        let bounds = self.chunks[self.colors.len() / CHUNK];
        let eleven = |which: usize, word: u32| {
            let parts = [
                f64::from(word >> 21) / 2047.0,
                f64::from(word >> 11 & 1023) / 1023.0,
                f64::from(word & 2047) / 2047.0,
            ];
            [0, 1, 2].map(|axis| bounds.at(which, axis, parts[axis]) as f32)
        };
        let byte = |shift: u32| (color >> shift & 255) as u8;
        let channel = |axis: usize| bounds.at(2, axis, f64::from(byte(24 - 8 * axis as u32)) / 255.0);
        self.colors.push([0, 1, 2].map(|axis| quantise::dc(channel(axis))));
        let g = &mut self.gaussians;
        g.means.push(eleven(0, position));
        g.rotations.push(unpack_rotation(rotation));
        g.log_scales.push(eleven(1, scale));
        g.opacity_logits.push(quantise::logit_of_byte(byte(0)));
    }

    fn finish_harmonics(&mut self) {
        let sh = &mut self.gaussians.sh;
        let index = sh.len() / (3 + self.harmonic_columns.len());
        sh.extend(self.colors[index]);
        sh.extend(self.harmonic_columns.iter().map(|&column| unpack_harmonic(self.row[column])));
    }
}

impl RowSink for Unpacked {
    fn row(&mut self) -> &mut [f64] {
        &mut self.row
    }

    fn finish_row(&mut self) {
        match self.part {
            Part::Chunk => {
                let mut values = [0.0; 18];
                // Without bounds colours are as they are.
                values[15..].fill(1.0);
                for (value, &column) in values.iter_mut().zip(&self.chunk_columns) {
                    *value = self.row[column] as f32;
                }
                self.chunks.push(Bounds::from_values(values));
            }
            Part::Vertex => self.finish_vertex(),
            Part::Harmonics => self.finish_harmonics(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SH_C0;
    use crate::scene::formats::Format;
    use crate::scene::formats::tests::{LARGEST, OPACITY, errors, random, round_trip, rounding};

    #[test]
    fn errors_are_half_a_step_of_the_chunk() {
        for degree in 0..=3 {
            let g = random(700, degree, 10 + u64::from(degree));
            let e = errors(&g, &round_trip(&g, Format::CompressedPly), &order::morton(&g));
            // A chunk is no larger than the whole: 40 along the axis of 11 bits, 9 along that of 10.
            assert!(e.mean <= (0.5_f64 * 40.0 / 2047.0).max(0.5 * 9.0 / 1023.0) + rounding(40.0), "{e:?}");
            assert!(e.log_scale <= 0.5 * 8.0 / 1023.0 + rounding(8.0) && e.opacity <= OPACITY, "{e:?}");
            assert!(e.rotation <= LARGEST * 0.5 / 1023.0 * SQRT_2, "{e:?}");
            // Colours of this scene have a range of 1.8 times the constant.
            assert!(e.color <= 0.5 / 255.0 * 1.8 * SH_C0 + rounding(1.0), "{e:?}");
            // 256 parts of -4 to 4.
            assert!(e.harmonics.iter().all(|&e| e <= 0.5 * 8.0 / 256.0 + rounding(4.0)), "{e:?}");
        }
    }
}
