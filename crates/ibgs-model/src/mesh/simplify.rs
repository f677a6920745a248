//! Decimation: fewer triangles by quadric edge collapse.

use super::{Mesh, MeshError};
use meshopt::{SimplifyOptions, VertexDataAdapter, typed_to_bytes};

/// How far a mesh is decimated: until one of the two stops it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Decimation {
    /// Triangles at most; without: as few as the error allows.
    pub triangles: Option<usize>,
    /// Largest distance from the mesh before, in scene units, as the root mean square over the collapsed triangles; without: no
    /// limit.
    pub max_error: Option<f64>,
}

impl Decimation {
    /// Whether the options make sense.
    ///
    /// # Errors
    /// [`MeshError::Option`].
    pub fn check(&self) -> Result<(), MeshError> {
        if let Some(count) = self.triangles.filter(|&count| count < 4) {
            let (option, wanted) = ("the number of triangles", "4 or more");
            return Err(MeshError::Option { option, value: count.to_string(), wanted });
        }
        match self.max_error {
            Some(error) if !(error > 0.0 && error.is_finite()) => {
                let (option, wanted) = ("the largest error", "a positive number");
                Err(MeshError::Option { option, value: error.to_string(), wanted })
            }
            _ => Ok(()),
        }
    }
}

impl Mesh {
    /// Decimates the mesh; vertices that stay keep their place, normal and colour. Returns the error in scene units, a root mean
    /// square over the collapsed triangles.
    ///
    /// # Errors
    /// [`MeshError::Option`].
    pub fn simplify(&mut self, decimation: &Decimation) -> Result<f64, MeshError> {
        decimation.check()?;
        if *decimation == Decimation::default() {
            return Ok(0.0);
        }
        let bytes = typed_to_bytes(&self.positions);
        let vertices = VertexDataAdapter::new(bytes, size_of::<[f32; 3]>(), 0).expect("whole vertices");
        let count = self.triangles.len();
        let most = 3 * decimation.triangles.unwrap_or(0).min(count);
        let largest = decimation.max_error.map_or(f32::MAX, |error| error as f32);
        let mut error = 0.0;
        let options = SimplifyOptions::ErrorAbsolute;
        let kept =
            meshopt::simplify(self.triangles.as_flattened(), &vertices, most, largest, options, Some(&mut error));
        if kept.is_empty() && count > 0 {
            let value = decimation.max_error.unwrap_or_default().to_string();
            return Err(MeshError::Option {
                option: "the largest error",
                value,
                wanted: "small enough to leave a triangle",
            });
        }
        self.triangles = kept.as_chunks::<3>().0.to_vec();
        self.drop_unused();
        Ok(error.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// A square of cells in the plane z = height(x, y), from 0 to 1.
    fn sheet(cells: u32, height: impl Fn(f32, f32) -> f32) -> Mesh {
        let side = cells + 1;
        let at = |i: u32| ((i % side) as f32 / cells as f32, (i / side) as f32 / cells as f32);
        let positions: Vec<[f32; 3]> = (0..side * side).map(at).map(|(x, y)| [x, y, height(x, y)]).collect();
        let corners = (0..cells * cells).map(|i| i / cells * side + i % cells);
        let triangles = corners.flat_map(|a| [[a, a + 1, a + side], [a + 1, a + side + 1, a + side]]).collect();
        let colors = positions.iter().map(|p| p.map(|v| (v.clamp(0.0, 1.0) * 255.0) as u8)).collect();
        let mut mesh = Mesh { positions, colors, triangles, ..Mesh::default() };
        mesh.find_normals();
        mesh
    }

    fn corners(mesh: &Mesh) -> impl Iterator<Item = [Vec3; 3]> {
        mesh.triangles.iter().map(|t| t.map(|i| Vec3::from(mesh.positions[i as usize])))
    }

    fn area(mesh: &Mesh) -> f32 {
        corners(mesh).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
    }

    #[test]
    fn a_plane_becomes_few_triangles_and_keeps_its_border() {
        let mut mesh = sheet(20, |_, _| 0.0);
        let error = mesh.simplify(&Decimation { max_error: Some(1e-3), triangles: None }).unwrap();
        assert!(mesh.triangles.len() <= 8 && error <= 1e-3, "{} triangles, {error}", mesh.triangles.len());
        assert!((area(&mesh) - 1.0).abs() < 1e-5, "{}", area(&mesh));
        for corner in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]] {
            let place = mesh.positions.iter().position(|&p| p == corner).unwrap();
            assert_eq!(mesh.colors[place], corner.map(|v| (v * 255.0) as u8));
        }
        assert_eq!((mesh.normals.len(), mesh.colors.len()), (mesh.positions.len(), mesh.positions.len()));
    }

    #[test]
    fn the_error_and_the_number_of_triangles_are_kept() {
        let wave = |x: f32, y: f32| 0.1 * (6.0 * x).sin() * (5.0 * y).cos();
        let whole = sheet(60, wave);
        let mut before = usize::MAX;
        for limit in [0.001, 0.005, 0.02] {
            let mut mesh = whole.clone();
            let error = mesh.simplify(&Decimation { max_error: Some(limit), triangles: None }).unwrap();
            assert!(error <= limit && mesh.triangles.len() < before / 2, "{limit}: {error}, {}", mesh.triangles.len());
            before = mesh.triangles.len();
            // Against the surface itself, at the corners and within; the error is a mean over a collapse.
            for [a, b, c] in corners(&mesh) {
                for p in [a, b, c, (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0, (a + b + c) / 3.0] {
                    let off = f64::from((p.z - wave(p.x, p.y)).abs());
                    assert!(off < 4.0 * limit, "{p} is off by {off} at a limit of {limit}");
                }
            }
        }
        let mut mesh = whole.clone();
        mesh.simplify(&Decimation { triangles: Some(500), max_error: None }).unwrap();
        assert!((400..=500).contains(&mesh.triangles.len()), "{}", mesh.triangles.len());
        let mut mesh = whole.clone();
        assert_eq!((mesh.simplify(&Decimation::default()).unwrap(), &mesh), (0.0, &whole));
    }

    #[test]
    fn a_mesh_with_fewer_triangles_stays_and_none_is_emptied() {
        let whole = sheet(4, |x, y| x * y);
        let mut mesh = whole.clone();
        mesh.simplify(&Decimation { triangles: Some(usize::MAX), max_error: None }).unwrap();
        assert_eq!(mesh.triangles.len(), whole.triangles.len());
        let mut mesh = whole.clone();
        match mesh.simplify(&Decimation { triangles: None, max_error: Some(1e30) }) {
            Ok(_) => assert!(!mesh.triangles.is_empty()),
            Err(error) => assert!(error.to_string().contains("leave a triangle") && mesh.triangles == whole.triangles),
        }
    }

    #[test]
    fn options_that_make_no_sense() {
        for (triangles, max_error, told) in [
            (Some(3), None, "the number of triangles is 3, which is not 4 or more"),
            (None, Some(0.0), "the largest error is 0, which is not a positive number"),
            (None, Some(f64::NAN), "the largest error is NaN"),
        ] {
            let error = sheet(2, |_, _| 0.0).simplify(&Decimation { triangles, max_error }).unwrap_err().to_string();
            assert!(error.contains(told), "{error}");
        }
    }
}
