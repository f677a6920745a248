//! How depths are fused, and defaults that fit the scene.

use super::depth_map::Pixel;
use super::{DepthMap, MeshError};
use crate::camera::Camera;
use glam::DVec3;

/// Voxels along the scene's extent, without a voxel size.
const VOXELS_ALONG: f64 = 512.0;
/// The largest depth, in median depths.
const MEDIAN_DEPTHS: f64 = 3.0;
/// Part of the points beyond either end of the extent, on each axis.
const OUTSIDE: f64 = 0.05;
/// Approximate number of pixels that are sampled for the defaults.
const SAMPLES: usize = 200_000;

/// How depths are fused; what is left out follows from the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FusionOptions {
    /// Side of a voxel in scene units. Without: 1/512 of the scene's extent, but not less than the median size of a pixel on the
    /// surface. The extent is the longest side of a box around the points seen, 5 % of them beyond either end of each axis
    /// aside.
    pub voxel: Option<f64>,
    /// Signed distances are cut off at this many voxels.
    pub truncation: f64,
    /// Largest depth in scene units; without: 3 times the median depth of all pixels.
    pub max_depth: Option<f64>,
    /// Least and largest corner of the box that is meshed; without: everything.
    pub bounds: Option<[DVec3; 2]>,
    /// What voxels and vertices are relative to ([`LocalSpace::file_offset`](crate::local_space::LocalSpace::file_offset)).
    pub offset: DVec3,
    /// Bytes that the voxels and the mesh may take; without: no limit.
    pub memory: Option<u64>,
}

impl Default for FusionOptions {
    fn default() -> Self {
        Self { voxel: None, truncation: 4.0, max_depth: None, bounds: None, offset: DVec3::ZERO, memory: None }
    }
}

impl FusionOptions {
    /// Whether every option makes sense.
    ///
    /// # Errors
    /// [`MeshError::Option`].
    pub fn check(&self) -> Result<(), MeshError> {
        let positive = |option, value: Option<f64>| match value {
            Some(v) if !(v > 0.0 && v.is_finite()) => {
                Err(MeshError::Option { option, value: v.to_string(), wanted: "a positive number" })
            }
            _ => Ok(()),
        };
        positive("the voxel size", self.voxel)?;
        positive("the largest depth", self.max_depth)?;
        // Under one voxel the surface would have holes; the bound above keeps the blocks near a pixel few.
        if !(1.0..=32.0).contains(&self.truncation) {
            let (value, wanted) = (self.truncation.to_string(), "from 1 to 32 voxels");
            return Err(MeshError::Option { option: "the truncation", value, wanted });
        }
        match self.bounds {
            Some([low, high]) if !low.cmplt(high).all() => {
                let value = format!("{low} to {high}");
                Err(MeshError::Option { option: "the box of the bounds", value, wanted: "larger than 0 on each axis" })
            }
            _ => Ok(()),
        }
    }
}

/// [`FusionOptions`] with every choice made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Side of a voxel in scene units.
    pub voxel: f64,
    /// Signed distances are cut off here, in scene units.
    pub truncation: f64,
    /// Largest depth in scene units.
    pub max_depth: f64,
    /// Least and largest corner of the box that is meshed.
    pub bounds: [DVec3; 2],
    /// What voxels and vertices are relative to.
    pub offset: DVec3,
    /// Bytes that the voxels and the mesh may take.
    pub memory: u64,
}

impl Plan {
    /// Chooses what the options leave open.
    ///
    /// # Errors
    /// [`MeshError::Option`] for an option that has no usable value, [`MeshError::NoSurface`] where no map has a depth.
    pub fn of(maps: &[DepthMap], options: &FusionOptions) -> Result<Self, MeshError> {
        options.check()?;
        let bounds = options.bounds.unwrap_or([DVec3::NEG_INFINITY, DVec3::INFINITY]);
        let total: usize = maps.iter().map(|map| map.pixels.len()).sum();
        let step = (total / SAMPLES).max(1);
        let samples = |map: &DepthMap| -> Vec<Sample> {
            let focal = map.camera.focal.min_element();
            let points = (0..map.pixels.len()).step_by(step).filter_map(|i| map.point(i));
            points.map(|(z, point)| Sample { z: z.into(), point, pixel: f64::from(z) / focal }).collect()
        };
        let mut samples: Vec<Sample> = maps.iter().flat_map(samples).collect();
        if samples.is_empty() {
            return Err(MeshError::NoSurface { place: "at all" });
        }
        let median = quantile(samples.iter().map(|s| s.z), 0.5);
        let max_depth = options.max_depth.unwrap_or(MEDIAN_DEPTHS * median);
        samples.retain(|s| s.z <= max_depth && inside(s.point, bounds));
        if samples.is_empty() {
            return Err(MeshError::NoSurface { place: "within the bounds and the largest depth" });
        }
        let side = |axis: usize| {
            let [low, high] =
                [OUTSIDE, 1.0 - OUTSIDE].map(|part| quantile(samples.iter().map(|s| s.point[axis]), part));
            high - low
        };
        let extent = side(0).max(side(1)).max(side(2));
        let voxel = options.voxel.unwrap_or_else(|| {
            let pixel = quantile(samples.iter().map(|s| s.pixel), 0.5);
            (extent / VOXELS_ALONG).max(pixel)
        });
        let truncation = options.truncation * voxel;
        let (offset, memory) = (options.offset, options.memory.unwrap_or(u64::MAX));
        Ok(Self { voxel, truncation, max_depth, bounds, offset, memory })
    }
}

struct Sample {
    z: f64,
    point: DVec3,
    /// Size of the pixel on the surface.
    pixel: f64,
}

/// Bytes that the depth maps of these views take.
pub fn maps_bytes<'a>(cameras: impl Iterator<Item = &'a Camera>) -> u64 {
    let bytes = |c: &Camera| u64::from(c.width) * u64::from(c.height) * size_of::<Pixel>() as u64;
    cameras.map(bytes).sum()
}

/// Whether a point lies in a box.
pub(super) fn inside(point: DVec3, [low, high]: [DVec3; 2]) -> bool {
    point.cmpge(low).all() && point.cmple(high).all()
}

/// The value with this part of the others below it. There is at least one.
fn quantile(values: impl Iterator<Item = f64>, part: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let at = (part * (values.len() - 1) as f64).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}
