//! The zero surface of a grid, by marching cubes.
//!
//! A vertex belongs to the voxel at the lower end of its edge, and through it to a block, so that cubes of neighbouring blocks
//! use the same one. Cubes with a corner that no view saw are left out.

use super::cube::{CASES, EDGES};
use super::tsdf::{Block, Grid, SIDE, VOXELS};
use super::{Mesh, MeshError};
use glam::{IVec3, Vec3};
use rayon::prelude::*;

/// Voxels along a block with those of the next blocks that its cubes need.
const WIDE: usize = SIDE + 1;
/// Vertices keep this part of an edge away from its ends, so that no triangle is without area.
const MARGIN: f32 = 1e-3;

/// The vertices in a block.
#[derive(Default)]
struct Vertices {
    /// 3 times the voxel plus the axis of the edge, ascending.
    edges: Vec<u16>,
    positions: Vec<[f32; 3]>,
    colors: Vec<[u8; 3]>,
}

/// Distances of a block and of the first layers of the next ones; NaN where there is no block.
type Padded = [f32; WIDE * WIDE * WIDE];

fn padded_index(x: usize, y: usize, z: usize) -> usize {
    (z * WIDE + y) * WIDE + x
}

fn voxel_index(x: usize, y: usize, z: usize) -> usize {
    (z * SIDE + y) * SIDE + x
}

/// Offset of a corner of a cube.
fn offset(corner: usize) -> [usize; 3] {
    [corner & 1, corner >> 1 & 1, corner >> 2 & 1]
}

/// A block with the seven beyond its upper sides, by [`offset`].
struct Neighbours<'a> {
    blocks: [Option<&'a Block>; 8],
    indices: [Option<u32>; 8],
}

impl<'a> Neighbours<'a> {
    fn of(grid: &'a Grid, block: &Block) -> Self {
        let at = |corner: usize| block.at + IVec3::from(offset(corner).map(|v| v as i32));
        let indices = std::array::from_fn(|corner| grid.index.get(&at(corner)).copied());
        Self { blocks: indices.map(|index: Option<u32>| index.map(|i| &grid.blocks[i as usize])), indices }
    }

    /// Which of the blocks a voxel from 0 to 8 lies in, and its index there.
    fn locate([x, y, z]: [usize; 3]) -> (usize, usize) {
        let corner = (x / SIDE) + 2 * (y / SIDE) + 4 * (z / SIDE);
        (corner, voxel_index(x % SIDE, y % SIDE, z % SIDE))
    }

    fn padded(&self) -> Padded {
        let mut padded = [f32::NAN; WIDE * WIDE * WIDE];
        for z in 0..WIDE {
            for y in 0..WIDE {
                for x in 0..WIDE {
                    let (corner, voxel) = Self::locate([x, y, z]);
                    if let Some(block) = self.blocks[corner] {
                        padded[padded_index(x, y, z)] = block.distance[voxel];
                    }
                }
            }
        }
        padded
    }

    fn color(&self, at: [usize; 3]) -> [u8; 4] {
        let (corner, voxel) = Self::locate(at);
        self.blocks[corner].map_or([0; 4], |block| block.color[voxel])
    }
}

impl Grid {
    /// The surface where the distance is zero, with colours and normals.
    ///
    /// # Errors
    /// [`MeshError::NoSurface`] when there is none.
    pub fn mesh(&self) -> Result<Mesh, MeshError> {
        let vertices: Vec<Vertices> = self.blocks.par_iter().map(|block| self.vertices(block)).collect();
        let mut firsts = Vec::with_capacity(vertices.len());
        let mut count = 0_usize;
        for block in &vertices {
            firsts.push(count);
            count += block.edges.len();
        }
        if u32::try_from(count).is_err() {
            let value = self.voxel.to_string();
            return Err(MeshError::Option { option: "the voxel size", value, wanted: "large enough for this scene" });
        }
        let global = |block: u32, edge: u16| {
            let edges = &vertices[block as usize].edges;
            let place = edges.binary_search(&edge).expect("the vertex of a cut edge");
            (firsts[block as usize] + place) as u32
        };
        let triangles = self.blocks.par_iter().map(|block| self.triangles(block, &global));
        let triangles: Vec<[u32; 3]> = triangles.collect::<Vec<_>>().concat();
        if triangles.is_empty() {
            return Err(MeshError::NoSurface { place: "that all views together agree on" });
        }
        let mut mesh = Mesh { offset: self.offset, triangles, ..Mesh::default() };
        for block in vertices {
            mesh.positions.extend(block.positions);
            mesh.colors.extend(block.colors);
        }
        mesh.find_normals();
        Ok(mesh)
    }

    fn vertices(&self, block: &Block) -> Vertices {
        let mut found = Vertices::default();
        let neighbours = Neighbours::of(self, block);
        let padded = neighbours.padded();
        for voxel in 0..VOXELS {
            let at = [voxel % SIDE, voxel / SIDE % SIDE, voxel / SIDE / SIDE];
            let here = padded[padded_index(at[0], at[1], at[2])];
            for axis in 0..3 {
                let mut next = at;
                next[axis] += 1;
                let there = padded[padded_index(next[0], next[1], next[2])];
                if here.is_nan() || there.is_nan() || (here < 0.0) == (there < 0.0) {
                    continue;
                }
                let part = (here / (here - there)).clamp(MARGIN, 1.0 - MARGIN);
                found.edges.push((3 * voxel + axis) as u16);
                found.positions.push(self.position(block, at, axis, part));
                found.colors.push(blend(neighbours.color(at), neighbours.color(next), part));
            }
        }
        found
    }

    /// A point on the edge from a voxel's centre along an axis.
    fn position(&self, block: &Block, at: [usize; 3], axis: usize, part: f32) -> [f32; 3] {
        let voxel = block.at * SIDE as i32 + IVec3::from(at.map(|v| v as i32));
        let mut point = voxel.as_dvec3() + 0.5;
        point[axis] += f64::from(part);
        (point * self.voxel).as_vec3().to_array()
    }

    fn triangles(&self, block: &Block, global: &impl Fn(u32, u16) -> u32) -> Vec<[u32; 3]> {
        let neighbours = Neighbours::of(self, block);
        let padded = neighbours.padded();
        let mut found = Vec::new();
        for voxel in 0..VOXELS {
            let at = [voxel % SIDE, voxel / SIDE % SIDE, voxel / SIDE / SIDE];
            let corner = |c: usize| std::array::from_fn::<usize, 3, _>(|axis| at[axis] + offset(c)[axis]);
            let distances: [f32; 8] = std::array::from_fn(|c| {
                let [x, y, z] = corner(c);
                padded[padded_index(x, y, z)]
            });
            if distances.iter().any(|d| d.is_nan()) {
                continue;
            }
            let case = (0..8).fold(0, |case, c| case | usize::from(distances[c] < 0.0) << c);
            let vertex = |e: u8| {
                let (lower, axis) = EDGES[usize::from(e)];
                let (owner, voxel) = Neighbours::locate(corner(lower));
                let owner = neighbours.indices[owner].expect("its distance was read");
                global(owner, (3 * voxel + axis) as u16)
            };
            found.extend(CASES[case].iter().map(|triangle| triangle.map(vertex)));
        }
        found
    }
}

/// The colour at a part of the way, or that of the end which has one.
fn blend(a: [u8; 4], b: [u8; 4], part: f32) -> [u8; 3] {
    let part = match (a[3], b[3]) {
        (0, _) => 1.0,
        (_, 0) => 0.0,
        _ => part,
    };
    let [a, b] = [a, b].map(|[r, g, b, _]| Vec3::from([r, g, b].map(f32::from)));
    (a.lerp(b, part) + 0.5).to_array().map(|v| v as u8)
}
