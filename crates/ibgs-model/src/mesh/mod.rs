//! From a model to a triangle mesh, and how good that is (method.md section 9).
//!
//! 1. [`DepthMap`] keeps what a rendered view says of the surface: median depth, colour, and how slanted it is seen.
//! 2. [`fuse`] averages the signed distances of all views in blocks of voxels near the surface (a TSDF).
//! 3. [`Grid::mesh`] finds the zero surface by marching cubes, with vertices shared between cubes and blocks.
//! 4. [`Mesh::keep_largest`] drops small pieces, [`Mesh::fill_holes`] closes holes, [`Mesh::simplify`] leaves fewer triangles.
//! 5. [`TexturedMesh`] has a texture of the photos in place of the vertices' colours.
//! 6. [`Mesh::write`] makes PLY, OBJ or binary glTF.
//! 7. [`score`] measures precision, recall and F1 as Tanks & Temples does and Chamfer distances as DTU does.
//!
//! All of it runs on the CPU, on all cores.

mod clusters;
mod cube;
mod depth_map;
mod error;
mod glb;
mod holes;
mod marching_cubes;
mod plan;
pub mod score;
mod simplify;
mod texture;
mod tsdf;
mod write;

pub use depth_map::DepthMap;
pub use error::MeshError;
pub use holes::MOST_HOLE_EDGES;
pub use plan::{FusionOptions, Plan, maps_bytes};
pub use simplify::Decimation;
pub use texture::{TextureOptions, TexturePhoto, TexturedMesh};
pub use tsdf::{Grid, fuse};
pub use write::MeshFormat;

use glam::{DVec3, Vec3};

/// A triangle mesh, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// What the positions are relative to: floats cannot hold a vertex far from the scene's origin.
    pub offset: DVec3,
    /// Vertices, in scene units.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals of the vertices, towards the free space.
    pub normals: Vec<[f32; 3]>,
    /// Colours of the vertices, sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Indices of three vertices each.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Sets each vertex's normal to the mean of its triangles' by area; (0, 0, 1) where there is none.
    pub(crate) fn find_normals(&mut self) {
        let mut sums = vec![Vec3::ZERO; self.positions.len()];
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|i| Vec3::from(self.positions[i as usize]));
            let normal = (b - a).cross(c - a);
            for &i in triangle {
                sums[i as usize] += normal;
            }
        }
        self.normals = sums.into_iter().map(|sum| sum.try_normalize().unwrap_or(Vec3::Z).to_array()).collect();
    }
}

#[cfg(test)]
mod tests;
