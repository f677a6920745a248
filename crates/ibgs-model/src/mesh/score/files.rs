//! Files of the truth: point clouds and meshes in PLY, matrices.

use super::Cloud;
use crate::mesh::MeshError;
use glam::{DMat4, DVec3};
use ibgs_data::ply_offset;
use serde::Deserialize;
use serde_ply::PlyReader;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::Path;

/// Most points on the triangles of a true surface, 48 bytes each.
const MOST_SAMPLES: f64 = 1e8;

#[derive(Deserialize)]
struct Vertex {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Deserialize)]
struct Face {
    #[serde(alias = "vertex_index")]
    vertex_indices: Vec<u32>,
}

/// What is read of a PLY file.
#[derive(Deserialize)]
struct Ply {
    vertex: Vec<Vertex>,
    #[serde(default)]
    face: Vec<Face>,
}

/// Reads a true surface from a PLY file: a point cloud as it is; of a mesh the points of [`Cloud::of_triangles`].
///
/// # Errors
/// [`MeshError::Read`], [`MeshError::Bad`] saying what is wrong.
pub fn read_truth(path: &Path, spacing: f64) -> Result<Cloud, MeshError> {
    let (ply, offset) = read_ply(path)?;
    let bad = |reason| MeshError::Bad { path: path.to_owned(), kind: "PLY file of a surface", reason };
    let points: Vec<DVec3> = ply.vertex.iter().map(|v| offset + DVec3::new(v.x, v.y, v.z)).collect();
    if let Some(index) = points.iter().position(|p| !p.is_finite()) {
        return Err(bad(format!("vertex {index} is {}", points[index])));
    }
    if points.is_empty() {
        return Err(bad("it has no vertices".to_owned()));
    }
    let mut triangles = Vec::new();
    for (index, face) in ply.face.iter().enumerate() {
        let corners = &face.vertex_indices;
        if let Some(corner) = corners.iter().find(|&&corner| corner as usize >= points.len()) {
            return Err(bad(format!("face {index} has vertex {corner} of {}", points.len())));
        }
        triangles.extend((2..corners.len()).map(|k| [corners[0], corners[k - 1], corners[k]]));
    }
    if triangles.is_empty() {
        return Ok(Cloud::new(points));
    }
    let needed: f64 = triangles.iter().map(|t| Cloud::samples(t.map(|i| points[i as usize]), spacing)).sum();
    if needed > MOST_SAMPLES {
        return Err(bad(format!(
            "its triangles would give {needed:.0} points {spacing} apart, more than {MOST_SAMPLES}; is it in other units?"
        )));
    }
    // Around one of them: floats cannot hold places far from the origin.
    let middle = points[0];
    let positions: Vec<[f32; 3]> = points.iter().map(|&p| (p - middle).as_vec3().to_array()).collect();
    Ok(Cloud::of_triangles(&positions, &triangles, spacing).shifted(middle))
}

/// The file, and what its vertices are relative to.
fn read_ply(path: &Path) -> Result<(Ply, DVec3), MeshError> {
    let bad = |reason: String| MeshError::Bad { path: path.to_owned(), kind: "PLY file of a surface", reason };
    let file = File::open(path).map_err(|source| MeshError::Read { path: path.to_owned(), source })?;
    let unread = |source| MeshError::Read { path: path.to_owned(), source };
    let mut file = BufReader::with_capacity(1 << 20, file);
    let header_length = {
        PlyReader::from_reader(&mut file).map_err(|error| bad(format!("its header is damaged ({})", error.0)))?;
        file.stream_position().map_err(unread)?
    };
    file.rewind().map_err(unread)?;
    let mut header = Vec::new();
    file.by_ref().take(header_length).read_to_end(&mut header).map_err(unread)?;
    let offset = ply_offset::find(&header).map_err(bad)?;
    file.rewind().map_err(unread)?;
    let mut reader =
        PlyReader::from_reader(file).map_err(|error| bad(format!("its header is damaged ({})", error.0)))?;
    // Rows without fields take no bytes, so no count could be checked.
    if let Some(empty) = reader.header().elem_defs.iter().find(|e| e.properties.is_empty()) {
        return Err(bad(format!("its element `{}` has no fields", empty.name)));
    }
    let ply = Ply::deserialize(&mut reader).map_err(|error| match error.0.kind() {
        io::ErrorKind::UnexpectedEof => bad("it ends before the last row that its header counts".to_owned()),
        _ => bad(error.0.to_string()),
    })?;
    Ok((ply, offset))
}

/// Reads a 4 x 4 matrix, row by row, as text: it maps the reconstruction to the truth.
///
/// # Errors
/// [`MeshError::Read`], [`MeshError::Bad`] naming the line.
pub fn read_transform(path: &Path) -> Result<DMat4, MeshError> {
    let text = std::fs::read_to_string(path).map_err(|source| MeshError::Read { path: path.to_owned(), source })?;
    parse_transform(&text).map_err(|reason| MeshError::Bad { path: path.to_owned(), kind: "4 x 4 matrix", reason })
}

fn parse_transform(text: &str) -> Result<DMat4, String> {
    let mut values = Vec::with_capacity(16);
    for (number, line) in (1..).zip(text.trim_start_matches('\u{feff}').lines()) {
        for word in line.split([' ', '\t', ',']).filter(|word| !word.is_empty()) {
            let value = word.parse::<f64>().ok().filter(|v| v.is_finite());
            values.push(value.ok_or_else(|| format!("line {number}: `{word}` is not a number"))?);
        }
    }
    let count = values.len();
    let values: [f64; 16] = values.try_into().map_err(|_| format!("it has {count} numbers, not 16"))?;
    if values[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err("its last row is not 0 0 0 1".to_owned());
    }
    let matrix = DMat4::from_cols_array(&values).transpose();
    if !matrix.determinant().is_normal() {
        return Err("it makes the surface flat (its determinant is 0)".to_owned());
    }
    Ok(matrix)
}
