//! A volume between two planes over a polygon, as Open3D's `SelectionPolygonVolume` writes it.

use crate::files::without_mark;
use crate::mesh::MeshError;
use glam::{DVec2, DVec3};
use serde::Deserialize;
use std::path::Path;

const KIND: &str = "crop volume";

/// A volume between two planes over a polygon.
#[derive(Clone, Debug, PartialEq)]
pub struct CropVolume {
    /// 0, 1 or 2: the axis that the polygon is seen along.
    axis: usize,
    /// Least and largest coordinate on that axis.
    range: [f64; 2],
    /// Corners in the other two axes, in their order.
    polygon: Vec<DVec2>,
}

/// The file; it may have more fields.
#[derive(Deserialize)]
struct File {
    orthogonal_axis: String,
    axis_min: f64,
    axis_max: f64,
    bounding_polygon: Vec<[f64; 3]>,
}

impl CropVolume {
    /// Reads the JSON file of a volume.
    ///
    /// # Errors
    /// [`MeshError::Read`], [`MeshError::Bad`] naming the field.
    pub fn read(path: &Path) -> Result<Self, MeshError> {
        let bytes = std::fs::read(path).map_err(|source| MeshError::Read { path: path.to_owned(), source })?;
        Self::parse(&bytes).map_err(|reason| MeshError::Bad { path: path.to_owned(), kind: KIND, reason })
    }

    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let file: File = serde_json::from_slice(without_mark(bytes)).map_err(|error| error.to_string())?;
        let axis = match file.orthogonal_axis.to_ascii_lowercase().as_str() {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            other => return Err(format!("`orthogonal_axis` is `{other}`, which is not x, y or z")),
        };
        let range = [file.axis_min, file.axis_max];
        if range[0] >= range[1] {
            return Err(format!("`axis_min` {} is not less than `axis_max` {}", range[0], range[1]));
        }
        if file.bounding_polygon.len() < 3 {
            return Err(format!("`bounding_polygon` has {} corners, and needs 3", file.bounding_polygon.len()));
        }
        let polygon = file.bounding_polygon.into_iter().map(|corner| across(axis, corner.into())).collect();
        Ok(Self { axis, range, polygon })
    }

    /// Whether a point lies inside.
    pub fn holds(&self, point: DVec3) -> bool {
        let height = point[self.axis];
        if !(self.range[0]..=self.range[1]).contains(&height) {
            return false;
        }
        let p = across(self.axis, point);
        // A ray to one side leaves the polygon once more than it enters.
        let ends = self.polygon.iter().zip(self.polygon.iter().cycle().skip(1));
        let crossed = |(a, b): (&DVec2, &DVec2)| {
            (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
        };
        ends.filter(|&ends| crossed(ends)).count() % 2 == 1
    }
}

/// The coordinates other than that on the axis.
fn across(axis: usize, p: DVec3) -> DVec2 {
    match axis {
        0 => DVec2::new(p.y, p.z),
        1 => DVec2::new(p.x, p.z),
        _ => DVec2::new(p.x, p.y),
    }
}
