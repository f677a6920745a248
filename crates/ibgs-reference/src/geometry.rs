//! Twin of what the blending kernel gives beside the base colour (method.md section 3): the planes of the Gaussians,
//! the depths at which pixel rays meet them, the median intersections, the normal map and the median depth.

use std::collections::VecDeque;

use glam::{DVec2, DVec3};
use ibgs_data::camera::Camera;
use rayon::prelude::*;

use super::raster::{Contribution, contributions, tile_pixels};
use super::{Forward, Params};

/// Keeps the divisions of sections 3 and 5 finite: added to n_c . r, to sums of weights and to lengths of rays.
pub const EPSILON: f64 = 1e-8;
/// While the transmittance is above it an intersection enters the buffer *before*, else the buffer *after*.
pub const MEDIAN_TRANSMITTANCE: f64 = 0.5;

/// Planes seen closer to edge-on than this are not met.
pub const SLANT_MIN: f64 = 1e-3;

/// The plane parameters before activation (section 1), one per Gaussian.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlaneParams {
    /// Not normalised, facing either way.
    pub normals: Vec<[f64; 3]>,
    /// How far the plane lies from the mean, against the raw normal.
    pub offsets: Vec<f64>,
}

/// The plane of a Gaussian as one camera sees it. All zero (never met by a ray) where the normal has no direction or a
/// number is not finite.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Plane {
    /// n_c: unit normal in camera space, facing the camera.
    pub normal: DVec3,
    /// D_c, not negative.
    pub distance: f64,
    /// n: the same unit normal in world space.
    pub world_normal: DVec3,
    /// Length of the raw normal.
    pub length: f64,
    /// -1 where the raw normal faces away from the camera: it and the offset are turned around.
    pub flip: f64,
    /// Sign of D - n_c . t, whose magnitude is D_c.
    pub sign: f64,
}

impl Plane {
    /// n . x + D = 0 with D = -n . mu + d; n_c = R n, D_c = |D - n_c . t|.
    pub fn new(mean: DVec3, raw_normal: DVec3, offset: f64, camera: &Camera) -> Plane {
        let length = raw_normal.length();
        let flip = if (camera.center() - mean).dot(raw_normal) < 0.0 { -1.0 } else { 1.0 };
        let world_normal = raw_normal * (flip / length);
        let normal = camera.view_from_world * world_normal;
        let signed = -world_normal.dot(mean) + flip * offset - normal.dot(camera.translation);
        if !(length > 0.0 && normal.is_finite() && signed.is_finite()) {
            return Plane::default();
        }
        Plane { normal, distance: signed.abs(), world_normal, length, flip, sign: signed.signum() }
    }

    /// n_c . r + 1e-8 for the ray r = (x, y, 1) in camera space.
    pub fn slant(&self, ray: DVec3) -> f64 {
        self.normal.dot(ray) + EPSILON
    }

    /// View depth z_i = -D_c / (n_c . r + 1e-8) at which the ray meets the plane; None unless it is positive, or where the
    /// ray passes along the plane (a departure, see `SLANT_MIN`).
    pub fn depth(&self, ray: DVec3) -> Option<f64> {
        let slant = self.slant(ray);
        Some(-self.distance / slant).filter(|z| *z > 0.0 && slant < -SLANT_MIN)
    }
}

/// One of the at most K median intersections of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intersection {
    /// Entry in the tile's list.
    pub entry: usize,
    pub gaussian: usize,
    /// View depth z_k at which the pixel's ray meets the Gaussian's plane.
    pub depth: f64,
    /// Blending weight alpha T.
    pub weight: f64,
    /// Transmittance before it.
    pub transmittance: f64,
}

/// What `geometry` gives. Pixels are row by row.
#[derive(Clone, Debug)]
pub struct Geometry {
    /// The blending that it accompanies.
    pub base: Forward,
    /// Per Gaussian.
    pub planes: Vec<Plane>,
    /// Sum of w_i n_c,i over all that was blended; not normalised.
    pub normal: Vec<[f64; 3]>,
    /// Median depth, 0 where nothing was met.
    pub depth: Vec<f64>,
    /// The median intersections front to back: those of the buffer *before*, then those of *after*.
    pub intersections: Vec<Vec<Intersection>>,
}

/// r = ((x - cx) / fx, (y - cy) / fy, 1) through the centre of the pixel (x, y), at +0.5.
pub fn pixel_ray(camera: &Camera, x: u32, y: u32) -> DVec3 {
    let center = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
    ((center - camera.principal) / camera.focal).extend(1.0)
}

/// The median intersections of one pixel, front to back: the last K/2 met while T > 0.5 and the first K/2 after.
pub fn median_intersections(parts: &[Contribution], planes: &[Plane], ray: DVec3, k: usize) -> Vec<Intersection> {
    let mut before = VecDeque::new();
    let mut after = Vec::new();
    for part in parts {
        let Some(depth) = planes[part.gaussian].depth(ray) else {
            continue;
        };
        let intersection = Intersection {
            entry: part.entry,
            gaussian: part.gaussian,
            depth,
            weight: part.alpha * part.transmittance,
            transmittance: part.transmittance,
        };
        if part.transmittance > MEDIAN_TRANSMITTANCE {
            before.push_back(intersection);
            if before.len() > k / 2 {
                before.pop_front();
            }
        } else if after.len() < k / 2 {
            after.push(intersection);
        }
    }
    before.into_iter().chain(after).collect()
}

/// sum_k w_k + 1e-8, the divisor of the median depth.
pub fn total_weight(intersections: &[Intersection]) -> f64 {
    intersections.iter().map(|s| s.weight).sum::<f64>() + EPSILON
}

/// sum_k w_k z_k / (sum_k w_k + 1e-8).
pub fn median_depth(intersections: &[Intersection]) -> f64 {
    intersections.iter().map(|s| s.weight * s.depth).sum::<f64>() / total_weight(intersections)
}

/// Geometry of a blended view with at most `k` median intersections per pixel.
pub fn geometry(p: &Params, plane_params: &PlaneParams, camera: &Camera, base: Forward, k: usize) -> Geometry {
    assert!(k >= 2 && k.is_multiple_of(2), "two buffers of K/2");
    let PlaneParams { normals, offsets } = plane_params;
    let plane = |i: usize| Plane::new(p.means[i].into(), normals[i].into(), offsets[i], camera);
    let planes: Vec<Plane> = (0..p.len()).map(plane).collect();

    let pixel = |(x, y): (u32, u32), list: &[u32]| {
        let (parts, _) = contributions(&base.projected, list, x, y);
        let normal: DVec3 = parts.iter().map(|c| planes[c.gaussian].normal * (c.alpha * c.transmittance)).sum();
        let intersections = median_intersections(&parts, &planes, pixel_ray(camera, x, y), k);
        ((y * camera.width + x) as usize, normal.to_array(), intersections)
    };
    let tiles: Vec<Vec<_>> = base
        .order
        .par_iter()
        .enumerate()
        .map(|(tile, list)| tile_pixels(camera, tile).map(|at| pixel(at, list)).collect())
        .collect();

    let mut normal = vec![[0.0; 3]; base.image.len()];
    let mut intersections = vec![Vec::new(); base.image.len()];
    for (i, n, s) in tiles.into_iter().flatten() {
        (normal[i], intersections[i]) = (n, s);
    }
    let depth = intersections.iter().map(|s| median_depth(s)).collect();
    Geometry { base, planes, normal, depth, intersections }
}
