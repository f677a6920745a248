//! Where each parameter stands in the rows of a PLY file, and the walk over those rows.

use super::formats::{Dropped, is_rotation, make_finite};
use super::gaussians::degree_of;
use super::{Gaussians, SH_C0, SceneError};
use crate::local_space::LocalSpace;
use crate::ply_color;
use glam::DVec3;
use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_ply::{ElementDef, PropertyType, ScalarType};
use std::collections::HashMap;
use std::fmt;
use std::path::Path;

/// What the columns of the constant colours hold.
#[derive(Clone, Copy)]
enum Constant {
    /// Coefficients of degree 0.
    Coefficients,
    /// Colours, and which number is white.
    Colors(f64),
    /// Colours as floats; their largest says which number is white.
    FloatColors,
}

impl Constant {
    fn of(kind: &PropertyType) -> Self {
        match kind {
            PropertyType::Scalar(ScalarType::F32 | ScalarType::F64) => Self::FloatColors,
            PropertyType::Scalar(ScalarType::U16) => Self::Colors(65535.0),
            _ => Self::Colors(255.0),
        }
    }
}

/// Columns of the parameters, found by name.
pub(super) struct Layout {
    mean: [usize; 3],
    normal: Option<[usize; 3]>,
    offset: Option<usize>,
    dc: [usize; 3],
    constant: Constant,
    /// Channel-major, as in the file.
    rest: Vec<usize>,
    opacity: usize,
    scale: [usize; 3],
    rotation: [usize; 4],
    sh_degree: u32,
}

impl Layout {
    /// Looks the fields up in the vertex element of the file at `path`.
    pub(super) fn new(vertex: &ElementDef, path: &Path) -> Result<Self, SceneError> {
        let columns = scalar_columns(vertex, path)?;
        let column = |field: &str| {
            columns
                .get(field)
                .copied()
                .ok_or_else(|| SceneError::MissingField { path: path.to_owned(), field: field.to_owned() })
        };
        if columns.contains_key("scale_1") && !columns.contains_key("scale_2") {
            return Err(SceneError::TwoScales { path: path.to_owned() });
        }
        let rest_count = columns.keys().filter(|name| name.starts_with("f_rest_")).count();
        let sh_degree = degree_of(rest_count).ok_or_else(|| SceneError::BadPly {
            path: path.to_owned(),
            reason: format!(
                "it has {rest_count} fields `f_rest_*` where spherical harmonics of degree 0, 1, 2, 3 have 0, 9, 24, 45"
            ),
        })?;
        let colors = |names: [&str; 3]| {
            let [red, green, blue] = names.map(|name| columns.get(name).copied());
            Some([red?, green?, blue?])
        };
        let (dc, constant) = match ply_color::NAMES.into_iter().find_map(colors) {
            Some(color) if !columns.contains_key("f_dc_0") => {
                (color, Constant::of(&vertex.properties[color[0]].property_type))
            }
            _ => ([column("f_dc_0")?, column("f_dc_1")?, column("f_dc_2")?], Constant::Coefficients),
        };
        let normal = match ["nx", "ny", "nz"].map(|name| columns.get(name).copied()) {
            [Some(x), Some(y), Some(z)] => Some([x, y, z]),
            _ => None,
        };
        Ok(Self {
            mean: [column("x")?, column("y")?, column("z")?],
            normal,
            offset: columns.get("nd").copied(),
            dc,
            constant,
            rest: (0..rest_count).map(|i| column(&format!("f_rest_{i}"))).collect::<Result<_, _>>()?,
            opacity: column("opacity")?,
            scale: [column("scale_0")?, column("scale_1")?, column("scale_2")?],
            rotation: [column("rot_0")?, column("rot_1")?, column("rot_2")?, column("rot_3")?],
            sh_degree,
        })
    }

    /// All columns that are read.
    fn used(&self) -> Vec<usize> {
        let mut used: Vec<usize> = self.mean.into();
        used.extend(self.normal.into_iter().flatten());
        used.extend(self.offset);
        used.extend(self.dc);
        used.extend(&self.rest);
        used.push(self.opacity);
        used.extend(self.scale);
        used.extend(self.rotation);
        used
    }

    /// Makes infinities finite that mean something.
    fn make_finite(&self, row: &mut [f32]) {
        let mut scales = self.scale.map(|c| row[c]);
        make_finite(&mut row[self.opacity], &mut scales);
        self.scale.into_iter().zip(scales).for_each(|(c, scale)| row[c] = scale);
    }

    /// Makes coefficients of the constant colours, which were appended as the file has them.
    fn finish_colors(&self, g: &mut Gaussians) {
        let row = 3 * g.sh_coefficients();
        let white = match self.constant {
            Constant::Coefficients => return,
            Constant::Colors(white) => white,
            Constant::FloatColors => {
                let largest = g.sh.chunks_exact(row).flat_map(|sh| &sh[..3]).fold(0.0_f32, |a, &b| a.max(b));
                ply_color::white_of_floats(largest.into())
            }
        };
        for value in g.sh.chunks_exact_mut(row).flat_map(|sh| &mut sh[..3]) {
            *value = ((f64::from(*value) / white - 0.5) / SH_C0) as f32;
        }
    }

    /// Appends the Gaussian in `row`, but for its mean.
    fn append(&self, row: &[f32], gaussians: &mut Gaussians) {
        let normal = self.normal.map_or([0.0; 3], |columns| columns.map(|c| row[c]));
        // Plain files carry zeros, which are no direction; a file with `nd` keeps what it has.
        let unset = self.offset.is_none() && normal == [0.0; 3];
        gaussians.normals.push(if unset { [0.0, 0.0, 1.0] } else { normal });
        gaussians.offsets.push(self.offset.map_or(0.0, |c| row[c]));
        gaussians.sh.extend(self.dc.map(|c| row[c]));
        let per_channel = self.rest.len() / 3;
        for k in 0..per_channel {
            gaussians.sh.extend([0, 1, 2].map(|channel| row[self.rest[channel * per_channel + k]]));
        }
        gaussians.opacity_logits.push(row[self.opacity]);
        gaussians.log_scales.push(self.scale.map(|c| row[c]));
        gaussians.rotations.push(self.rotation.map(|c| row[c]));
    }
}

/// Column of every scalar field; lists and repeated names are refused.
pub(super) fn scalar_columns<'a>(vertex: &'a ElementDef, path: &Path) -> Result<HashMap<&'a str, usize>, SceneError> {
    let bad = |reason| SceneError::BadPly { path: path.to_owned(), reason };
    let mut columns = HashMap::with_capacity(vertex.properties.len());
    for (column, property) in vertex.properties.iter().enumerate() {
        let name = property.name.as_str();
        if let PropertyType::List { .. } = property.property_type {
            return Err(bad(format!("its vertex field `{name}` is a list where a Gaussian has one number")));
        }
        if columns.insert(name, column).is_some() {
            return Err(bad(format!("its vertex element has two fields `{name}`")));
        }
    }
    Ok(columns)
}

/// Takes the rows of an element.
pub(super) trait RowSink {
    /// Where the numbers of the next row go.
    fn row(&mut self) -> &mut [f64];
    /// The row is there.
    fn finish_row(&mut self);
}

/// Gathers Gaussians row by row; those with values that are not finite or without a rotation are left out.
pub(super) struct Rows<'a> {
    layout: &'a Layout,
    vertex: &'a ElementDef,
    used: Vec<usize>,
    row: Vec<f64>,
    /// The row in single precision.
    single: Vec<f32>,
    /// Means that were read so far.
    means: Vec<DVec3>,
    /// What was read so far, without its means.
    gaussians: Gaussians,
    /// Rows that were read so far.
    read: usize,
    dropped: Dropped,
}

impl<'a> Rows<'a> {
    /// The count in `vertex` must have been compared with the length of the file before: it is reserved here.
    pub(super) fn new(layout: &'a Layout, vertex: &'a ElementDef) -> Self {
        Self {
            layout,
            vertex,
            used: layout.used(),
            row: vec![0.0; vertex.properties.len()],
            single: vec![0.0; vertex.properties.len()],
            means: Vec::with_capacity(vertex.count),
            gaussians: Gaussians::with_capacity(vertex.count, layout.sh_degree),
            read: 0,
            dropped: Dropped::default(),
        }
    }

    /// Rows that were read so far.
    pub(super) fn read(&self) -> usize {
        self.read
    }

    /// What was read of the file at `path`, in scene units around its offset.
    ///
    /// # Errors
    /// [`SceneError::NotFinite`] or [`SceneError::ZeroRotations`] where nothing of it can be used.
    pub(super) fn around(mut self, offset: DVec3, path: &Path) -> Result<Gaussians, SceneError> {
        self.dropped.report(self.means.len(), path)?;
        self.layout.finish_colors(&mut self.gaussians);
        // Doubles of a map's coordinates lose digits as floats, unless they are taken from their middle.
        let is_exact = self.means.iter().all(|mean| mean.as_vec3().as_dvec3() == *mean);
        let middle = LocalSpace::of_points(self.means.iter().copied()).filter(|_| !is_exact);
        let shift = middle.and_then(|space| space.file_offset()).unwrap_or_default();
        self.gaussians.space = LocalSpace::at(offset + shift);
        self.gaussians.means = self.means.iter().map(|&mean| (mean - shift).as_vec3().to_array()).collect();
        Ok(self.gaussians)
    }
}

impl RowSink for Rows<'_> {
    fn row(&mut self) -> &mut [f64] {
        &mut self.row
    }

    fn finish_row(&mut self) {
        for (single, value) in self.single.iter_mut().zip(&self.row) {
            *single = *value as f32;
        }
        self.layout.make_finite(&mut self.single);
        let index = self.read;
        self.read += 1;
        if let Some(&column) = self.used.iter().find(|&&c| !self.single[c].is_finite()) {
            self.dropped.add(index, &self.vertex.properties[column].name, self.single[column]);
            return;
        }
        if !is_rotation(self.layout.rotation.map(|column| self.single[column])) {
            self.dropped.add_unturned(index);
            return;
        }
        self.means.push(DVec3::from(self.layout.mean.map(|column| self.row[column])));
        self.layout.append(&self.single, &mut self.gaussians);
    }
}

/// Reads all rows of one element, or skips them.
pub(super) struct ElementSeed<'r>(pub(super) Option<&'r mut dyn RowSink>);

impl<'de> DeserializeSeed<'de> for ElementSeed<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for ElementSeed<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the rows of an element")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<(), A::Error> {
        match self.0 {
            Some(target) => {
                while rows.next_element_seed(RowSeed(target.row()))?.is_some() {
                    target.finish_row();
                }
            }
            None => while rows.next_element_seed(SkipSeed)?.is_some() {},
        }
        Ok(())
    }
}

/// Reads one row of scalars into the slice.
struct RowSeed<'r>(&'r mut [f64]);

impl<'de> DeserializeSeed<'de> for RowSeed<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for RowSeed<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a row of numbers")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut fields: A) -> Result<(), A::Error> {
        // The names were read in the header, in this order.
        for value in self.0.iter_mut() {
            fields.next_key::<IgnoredAny>()?.ok_or_else(|| A::Error::custom("the row is short of a field"))?;
            *value = fields.next_value_seed(NumberSeed)?;
        }
        Ok(())
    }
}

/// Skips one row.
struct SkipSeed;

impl<'de> DeserializeSeed<'de> for SkipSeed {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(IgnoredAny).map(|_| ())
    }
}

/// Any scalar; what does not fit a 32-bit float is refused with its field's name.
struct NumberSeed;

impl<'de> DeserializeSeed<'de> for NumberSeed {
    type Value = f64;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<f64, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl Visitor<'_> for NumberSeed {
    type Value = f64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number")
    }

    fn visit_f32<E: Error>(self, v: f32) -> Result<f64, E> {
        Ok(v.into())
    }

    fn visit_f64<E: Error>(self, v: f64) -> Result<f64, E> {
        Ok(v)
    }

    fn visit_i64<E: Error>(self, v: i64) -> Result<f64, E> {
        Ok(v as f64)
    }

    fn visit_u64<E: Error>(self, v: u64) -> Result<f64, E> {
        Ok(v as f64)
    }
}
