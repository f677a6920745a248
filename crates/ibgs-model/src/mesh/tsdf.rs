//! Truncated signed distances to the surface, in blocks of voxels near it.
//!
//! Block by block, all views are averaged at once: the sums never leave the cache, no two threads write to the same place, and
//! the order of the sums is that of the views. A distance is that to the plane of the pixel, (z - z_voxel) cos, so that slanted
//! views agree with others; a voxel far before a surface counts as far, which clears what single views see in free space.

use super::plan::{Plan, inside};
use super::{DepthMap, MeshError};
use crate::progress::Progress;
use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};

/// Voxels along a block.
pub(super) const SIDE: usize = 8;
/// Voxels in a block.
pub(super) const VOXELS: usize = SIDE * SIDE * SIDE;

/// Bytes of a block: distances, colours, its place in the map.
const BLOCK_BYTES: u64 = (VOXELS * 8 + 96) as u64;
/// Bytes of the part of the mesh in a block, about: a layer of vertices with two triangles each, once before and once after
/// small pieces are dropped.
const MESH_BYTES: u64 = (2 * SIDE * SIDE * (27 + 24)) as u64;
/// Coordinates of blocks stay below this, so that those of voxels fit 32 bits.
const FARTHEST: f64 = (1_u32 << 27) as f64;

/// Weight of a view that only shows that a voxel is free. Many views pass close by a surface and do not show where it
/// is; at full weight they would push it back.
const FREE: f32 = 0.1;

/// Signed distances and colours of the voxels near the surface.
#[derive(Debug)]
pub struct Grid {
    /// What the blocks' places are relative to.
    pub offset: DVec3,
    /// Side of a voxel in scene units; voxel (0, 0, 0) begins at the offset.
    pub voxel: f64,
    /// Number of pairs of a voxel and a view that were looked at.
    pub looked_at: u64,
    pub(super) blocks: Vec<Block>,
    /// Place of each block by its coordinates.
    pub(super) index: HashMap<IVec3, u32>,
}

/// 8 x 8 x 8 voxels, x fastest.
#[derive(Debug)]
pub(super) struct Block {
    /// Its place, in blocks.
    pub at: IVec3,
    /// Distance in scene units, positive in free space; NaN where nothing was seen.
    pub distance: Box<[f32; VOXELS]>,
    /// sRGB.
    pub color: Box<[[u8; 4]; VOXELS]>,
}

impl Grid {
    /// Bytes of the voxels.
    pub fn bytes(&self) -> u64 {
        self.blocks.len() as u64 * BLOCK_BYTES
    }

    /// Number of voxels.
    pub fn voxels(&self) -> u64 {
        self.blocks.len() as u64 * VOXELS as u64
    }
}

/// Fuses depth maps. `progress` counts blocks.
///
/// # Errors
/// [`MeshError::Voxels`] when they need more memory than allowed, [`MeshError::NoSurface`] when no depth lies within the plan's
/// limits.
pub fn fuse(maps: &[DepthMap], plan: &Plan, progress: &dyn Progress) -> Result<Grid, MeshError> {
    let found = places(maps, plan)?.ok_or_else(|| too_fine(maps, plan))?;
    let mut places: Vec<IVec3> = found.into_iter().collect();
    if places.is_empty() {
        return Err(MeshError::NoSurface { place: "within the bounds and the largest depth" });
    }
    // The same grid whatever the hash; neighbours in space follow each other and read the same pixels.
    places.par_sort_unstable_by_key(|p| (p.z, p.y, p.x));
    progress.begin("fusing", places.len());
    let views: Vec<View> = maps.iter().map(|map| View::new(map, plan)).collect();
    let fused = places.into_par_iter().map(|at| {
        let fused = fuse_block(at, &views, plan);
        progress.step();
        fused
    });
    let (blocks, counts): (Vec<Block>, Vec<u64>) = fused.unzip();
    let index = blocks.iter().enumerate().map(|(i, block)| (block.at, i as u32)).collect();
    Ok(Grid { offset: plan.offset, voxel: plan.voxel, looked_at: counts.into_iter().sum(), blocks, index })
}

/// The error for voxels that do not fit, with a voxel size that does.
fn too_fine(maps: &[DepthMap], plan: &Plan) -> MeshError {
    let mut larger = *plan;
    // Half as large again at a time, far beyond any scene.
    for _ in 0..100 {
        larger.voxel *= 1.5;
        larger.truncation *= 1.5;
        if matches!(places(maps, &larger), Ok(Some(_))) {
            break;
        }
    }
    MeshError::Voxels { voxel: plan.voxel, limit: plan.memory, enough: larger.voxel }
}

/// The blocks that have a voxel nearer to a seen point than the truncation, on each axis; none where they do not fit.
fn places(maps: &[DepthMap], plan: &Plan) -> Result<Option<HashSet<IVec3>>, MeshError> {
    let block = SIDE as f64 * plan.voxel;
    let fit = |found: &HashSet<IVec3>| found.len() as u64 * (BLOCK_BYTES + MESH_BYTES) <= plan.memory;
    // The voxel around the point and its neighbours are there whatever the truncation.
    let reach = plan.truncation.max(2.0 * plan.voxel);
    let of_map = |map: &DepthMap| -> Result<Option<HashSet<IVec3>>, MeshError> {
        let mut found = HashSet::new();
        let mut last = [IVec3::MAX; 2];
        for (z, point) in (0..map.pixels.len()).filter_map(|i| map.point(i)) {
            if f64::from(z) > plan.max_depth || !inside(point, plan.bounds) {
                continue;
            }
            let [low, high] = [point - reach, point + reach].map(|p| ((p - plan.offset) / block).floor());
            if low.abs().max(high.abs()).max_element() > FARTHEST {
                let value = plan.voxel.to_string();
                return Err(MeshError::Option {
                    option: "the voxel size",
                    value,
                    wanted: "large enough for this scene",
                });
            }
            let range = [low.as_ivec3(), high.as_ivec3()];
            if range == last {
                continue;
            }
            last = range;
            let [low, high] = range;
            for z in low.z..=high.z {
                for y in low.y..=high.y {
                    found.extend((low.x..=high.x).map(|x| IVec3::new(x, y, z)));
                }
            }
            if !fit(&found) {
                return Ok(None);
            }
        }
        Ok(Some(found))
    };
    maps.par_iter().map(of_map).try_reduce(
        || Some(HashSet::new()),
        |a, b| {
            let (Some(a), Some(b)) = (a, b) else { return Ok(None) };
            let (mut large, small) = if a.len() > b.len() { (a, b) } else { (b, a) };
            large.extend(small);
            Ok(fit(&large).then_some(large))
        },
    )
}

/// A view, ready to be looked at from every block.
struct View<'a> {
    map: &'a DepthMap,
    /// Inner normals of the image's side planes in view space.
    sides: [Vec3; 4],
    focal: [f32; 2],
    /// The first pixel's centre lies at 0.
    principal: [f32; 2],
    least_inverse: f32,
    /// Steps of one voxel along the world's axes, in view space.
    steps: [Vec3; 3],
}

impl<'a> View<'a> {
    fn new(map: &'a DepthMap, plan: &Plan) -> Self {
        let c = &map.camera;
        let (low, high) =
            (-c.principal / c.focal, (glam::DVec2::new(c.width.into(), c.height.into()) - c.principal) / c.focal);
        let side = |x: f64, y: f64, z: f64| DVec3::new(x, y, z).normalize().as_vec3();
        let rotation = c.view_from_world;
        Self {
            map,
            sides: [side(1.0, 0.0, -low.x), side(-1.0, 0.0, high.x), side(0.0, 1.0, -low.y), side(0.0, -1.0, high.y)],
            focal: c.focal.as_vec2().to_array(),
            principal: (c.principal - 0.5).as_vec2().to_array(),
            least_inverse: (1.0 / plan.max_depth) as f32,
            steps: [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(|axis| (axis * plan.voxel).as_vec3()),
        }
    }

    /// Whether a ball in view space may be in the image.
    fn meets(&self, center: Vec3, radius: f32) -> bool {
        center.z > -radius && self.sides.iter().all(|side| side.dot(center) > -radius)
    }
}

/// Sums over the views at a voxel.
#[derive(Clone, Copy, Default)]
struct Sum {
    distance: f32,
    weight: f32,
    color: Vec3,
    color_weight: f32,
}

fn fuse_block(at: IVec3, views: &[View], plan: &Plan) -> (Block, u64) {
    let mut sums = [Sum::default(); VOXELS];
    let corner = (at * SIDE as i32).as_dvec3();
    let first = (corner + 0.5) * plan.voxel + plan.offset;
    let center = (corner + 0.5 * SIDE as f64) * plan.voxel + plan.offset;
    let radius = (0.5 * 3_f64.sqrt() * SIDE as f64 * plan.voxel) as f32;
    let mut looked_at = 0;
    for view in views {
        let camera = &view.map.camera;
        if view.meets(camera.to_view(center).as_vec3(), radius) {
            add_view(&mut sums, view, camera.to_view(first).as_vec3(), plan.truncation as f32);
            looked_at += VOXELS as u64;
        }
    }
    let mut block = Block { at, distance: Box::new([f32::NAN; VOXELS]), color: Box::new([[0; 4]; VOXELS]) };
    let crosses = !(inside(first, plan.bounds) && inside(first + (SIDE - 1) as f64 * plan.voxel, plan.bounds));
    for (i, sum) in sums.iter().enumerate().filter(|(_, sum)| sum.weight > 0.0) {
        let local = DVec3::new((i % SIDE) as f64, (i / SIDE % SIDE) as f64, (i / SIDE / SIDE) as f64);
        if crosses && !inside(first + local * plan.voxel, plan.bounds) {
            continue;
        }
        block.distance[i] = sum.distance / sum.weight;
        if sum.color_weight > 0.0 {
            let [r, g, b] = (sum.color / sum.color_weight + 0.5).to_array().map(|v| v as u8);
            block.color[i] = [r, g, b, 255];
        }
    }
    (block, looked_at)
}

/// Adds a view to the sums of a block whose first voxel lies at `first` in view space.
fn add_view(sums: &mut [Sum; VOXELS], view: &View, first: Vec3, truncation: f32) {
    let [step_x, step_y, step_z] = view.steps;
    let ([fx, fy], [cx, cy]) = (view.focal, view.principal);
    for (row, sums) in sums.chunks_exact_mut(SIDE).enumerate() {
        let start = first + step_y * (row % SIDE) as f32 + step_z * (row / SIDE) as f32;
        for (i, sum) in sums.iter_mut().enumerate() {
            let p = start + step_x * i as f32;
            if p.z <= 1e-6 {
                continue;
            }
            let scale = 1.0 / p.z;
            let Some((inverse, pixel)) = view.map.read(fx * p.x * scale + cx, fy * p.y * scale + cy, truncation) else {
                continue;
            };
            let cosine = f32::from(pixel.cosine) * (1.0 / 255.0);
            // Along the ray, then across the surface.
            let along = (1.0 / inverse - p.z) * (p.length() * scale);
            let distance = along * cosine;
            // Behind an outline there is free space; a depth that is too large says something about what lies before it.
            if along < -truncation || (inverse < view.least_inverse && distance < truncation) {
                continue;
            }
            // The deeper a point lies behind a surface, the less the view knows of it.
            let behind = 1.0 + distance.min(0.0) / truncation;
            let known = if distance < truncation { behind * behind } else { FREE };
            let weight = cosine * known;
            sum.weight += weight;
            sum.distance += weight * distance.min(truncation);
            if distance < truncation {
                sum.color += weight * Vec3::from(pixel.color.map(f32::from));
                sum.color_weight += weight;
            }
        }
    }
}
