//! Twin of the backward passes of warping and of the blending with its geometry (method.md sections 3, 5 and 7): true
//! derivatives, thresholds, choices and the sources' depth maps held fixed.
//!
//! Departs from the published code as section 10 tells: planes get the derivative once and also where no source sees
//! the pixel (10.1), the median weights know the transmittance (10.2), the bilinear read is differentiated as it was
//! done (10.3) and the cosine has a derivative (10.4).

use glam::{DVec2, DVec3};
use ibgs_data::camera::Camera;
use rayon::prelude::*;

use super::backward::{Sum, dot, splat_grads};
use super::geometry::{Geometry, Intersection, Plane, PlaneParams, pixel_ray, total_weight};
use super::project::project_backward_as;
use super::raster::{contributions, tile_pixels};
use super::warp::{Pair, Seen, Source, seen_by};
use super::{Grads, Params, SplatGrads};

/// Gradients of a loss by everything that the target view gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Cotangents {
    /// Per pixel, by the base colour.
    pub base: Vec<[f64; 3]>,
    /// Per pixel, by the normal map.
    pub normal: Vec<[f64; 3]>,
    /// Per pixel, by the median depth.
    pub depth: Vec<f64>,
    /// Per visible source, then pixel, by the warped colour.
    pub warped: Vec<[f64; 3]>,
    /// Per visible source, then pixel, by the cosine.
    pub cosine: Vec<f64>,
}

impl Cotangents {
    /// No gradient at all.
    pub fn zeros(pixels: usize, sources: usize) -> Cotangents {
        Cotangents {
            base: vec![[0.0; 3]; pixels],
            normal: vec![[0.0; 3]; pixels],
            depth: vec![0.0; pixels],
            warped: vec![[0.0; 3]; sources * pixels],
            cosine: vec![0.0; sources * pixels],
        }
    }
}

/// Gradient by one median intersection.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct IntersectionGrad {
    pub depth: f64,
    pub weight: f64,
}

/// Gradients by what the warping reads, per pixel: the output of `warp_backward`.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceGrads {
    /// By the median intersections, as the geometry's intersections.
    pub intersections: Vec<Vec<IntersectionGrad>>,
    /// By the median depth.
    pub depth: Vec<f64>,
}

/// Gradients by a plane as the camera sees it: n_c and D_c.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlaneGrad {
    pub normal: DVec3,
    pub distance: f64,
}

/// Gradients by what the blending reads, per Gaussian: the output of `blend_backward`.
#[derive(Clone, Debug, Default)]
pub struct BlendGrads {
    pub splat: SplatGrads,
    pub planes: Vec<PlaneGrad>,
}

/// Gradients by all raw parameters.
#[derive(Clone, Debug, Default)]
pub struct GeometryGrads {
    pub base: Grads,
    pub normals: Vec<[f64; 3]>,
    pub offsets: Vec<f64>,
}

/// One source's part: warped = sum w_k c(u_k(z_k)) / sum w_k over the intersections inside.
fn warped_backward(
    pair: &Pair,
    seen: &Seen,
    intersections: &[Intersection],
    v_warped: [f64; 3],
    out: &mut [IntersectionGrad],
) {
    for (k, landing) in &seen.landings {
        let color = landing.read.read(&pair.source.photo);
        out[*k].weight += (dot(v_warped, color) - dot(v_warped, seen.warped)) / seen.weight;
        let [by_u, by_v] = landing.read.slope(&pair.source.photo).map(|slope| dot(v_warped, slope));
        let along = DVec2::new(by_u, by_v).dot(landing.uv_by_depth);
        out[*k].depth += along * intersections[*k].weight / seen.weight;
    }
}

/// Gradients by the median intersections and depths, given those by warped colours and cosines.
pub fn warp_backward(camera: &Camera, geometry: &Geometry, sources: &[Source], v: &Cotangents) -> SurfaceGrads {
    let pairs: Vec<Pair> = sources.iter().map(|s| Pair::new(camera, s)).collect();
    let pixels = geometry.depth.len();
    let pixel_grad = |pixel: usize| {
        let intersections = &geometry.intersections[pixel];
        let mut out = vec![IntersectionGrad::default(); intersections.len()];
        let mut v_depth = 0.0;
        for (m, (source, seen)) in seen_by(camera, geometry, &pairs, pixel).iter().enumerate() {
            let at = m * pixels + pixel;
            warped_backward(&pairs[*source], seen, intersections, v.warped[at], &mut out);
            v_depth += v.cosine[at] * seen.cosine_by_depth;
        }
        (out, v_depth)
    };
    let (intersections, depth) = (0..pixels).into_par_iter().map(pixel_grad).unzip();
    SurfaceGrads { intersections, depth }
}

/// median = sum w_k z_k / (sum w_k + 1e-8): adds the gradient by it to those by the intersections.
pub(super) fn median_backward(
    intersections: &[Intersection],
    median: f64,
    v_median: f64,
    v_intersections: &mut [IntersectionGrad],
) {
    let weight = total_weight(intersections);
    for (intersection, v) in intersections.iter().zip(v_intersections) {
        v.depth += v_median * intersection.weight / weight;
        v.weight += v_median * (intersection.depth - median) / weight;
    }
}

/// Sums of one Gaussian over pixels.
#[derive(Clone, Copy, Default)]
struct BlendSum {
    splat: Sum,
    plane: PlaneGrad,
}

impl BlendSum {
    /// z = -D_c / (n_c . r + 1e-8).
    fn add_depth(&mut self, plane: &Plane, ray: DVec3, depth: f64, v_depth: f64) {
        let slant = plane.slant(ray);
        self.plane.distance -= v_depth / slant;
        self.plane.normal -= ray * (v_depth * depth / slant);
    }
}

/// The gradients that reach one pixel's blending.
struct PixelGrads {
    base: [f64; 3],
    normal: DVec3,
    /// As the pixel's intersections, the median depth's part included.
    intersections: Vec<IntersectionGrad>,
}

/// Walks one pixel back to front. Whatever the loss is, it depends on the weights w_i = alpha_i T_i, the colours and
/// the planes; `behind` is the sum of w_j v_w_j over all behind, and the background's.
fn pixel_backward(
    camera: &Camera,
    background: [f64; 3],
    geometry: &Geometry,
    (tile, x, y): (usize, u32, u32),
    v: &PixelGrads,
    sums: &mut [BlendSum],
) {
    let base = &geometry.base;
    let ray = pixel_ray(camera, x, y);
    let intersections = &geometry.intersections[(y * camera.width + x) as usize];
    let mut intersections = intersections.iter().zip(&v.intersections).rev().peekable();
    let (parts, final_t) = contributions(&base.projected, &base.order[tile], x, y);
    let mut behind = final_t * dot(v.base, background);
    for part in parts.iter().rev() {
        let (splat, plane) = (&base.projected[part.gaussian], &geometry.planes[part.gaussian]);
        let sum = &mut sums[part.entry];
        let weight = part.alpha * part.transmittance;
        let mut v_weight = dot(v.base, splat.color) + v.normal.dot(plane.normal);
        sum.plane.normal += v.normal * weight;
        if let Some((intersection, v_intersection)) =
            intersections.next_if(|(intersection, _)| intersection.entry == part.entry)
        {
            v_weight += v_intersection.weight;
            sum.add_depth(plane, ray, intersection.depth, v_intersection.depth);
        }
        // Behind it every weight carries the factor 1 - alpha.
        let v_alpha = part.transmittance * v_weight - behind / (1.0 - part.alpha);
        sum.splat.add_part(splat, part, v_alpha, v.base.map(|c| c * weight));
        behind += weight * v_weight;
    }
}

/// Gradients by what the blending reads, given those by its image, its normal map and its surface (there `depth` is the
/// whole gradient by the median depth). Sums run over the pixels of a tile, then over the tiles in order.
pub fn blend_backward(
    camera: &Camera,
    background: [f64; 3],
    geometry: &Geometry,
    v_base: &[[f64; 3]],
    v_normal: &[[f64; 3]],
    v_surface: &SurfaceGrads,
) -> BlendGrads {
    let base = &geometry.base;
    let tile_sums = |(tile, list): (usize, &Vec<u32>)| {
        let mut sums = vec![BlendSum::default(); list.len()];
        for (x, y) in tile_pixels(camera, tile) {
            let i = (y * camera.width + x) as usize;
            let mut intersections = v_surface.intersections[i].clone();
            median_backward(&geometry.intersections[i], geometry.depth[i], v_surface.depth[i], &mut intersections);
            let v = PixelGrads { base: v_base[i], normal: v_normal[i].into(), intersections };
            pixel_backward(camera, background, geometry, (tile, x, y), &v, &mut sums);
        }
        sums
    };
    let tiles: Vec<Vec<BlendSum>> = base.order.par_iter().enumerate().map(tile_sums).collect();

    let mut total = vec![BlendSum::default(); base.projected.len()];
    for (list, sums) in base.order.iter().zip(&tiles) {
        for (gaussian, sum) in list.iter().zip(sums) {
            let total = &mut total[*gaussian as usize];
            total.splat.add_sum(&sum.splat);
            total.plane.normal += sum.plane.normal;
            total.plane.distance += sum.plane.distance;
        }
    }
    let splats: Vec<Sum> = total.iter().map(|t| t.splat).collect();
    BlendGrads { splat: splat_grads(&splats), planes: total.iter().map(|t| t.plane).collect() }
}

/// From n_c and D_c to mean, raw normal and raw offset.
fn plane_backward(
    mean: DVec3,
    raw_normal: DVec3,
    camera: &Camera,
    plane: &Plane,
    v: &PlaneGrad,
) -> (DVec3, DVec3, f64) {
    if plane.length == 0.0 {
        return (DVec3::ZERO, DVec3::ZERO, 0.0);
    }
    // D_c = |-n . mu + d - n_c . t| with n_c = R n.
    let v_signed = plane.sign * v.distance;
    let v_view = v.normal - camera.translation * v_signed;
    let v_world = camera.view_from_world.transpose() * v_view - mean * v_signed;
    let v_mean = -plane.world_normal * v_signed;
    // n and d are the normalised raw normal and the raw offset, both turned around where the normal faces away.
    let unit = raw_normal / plane.length;
    let v_unit = plane.flip * v_world;
    (v_mean, (v_unit - unit * unit.dot(v_unit)) / plane.length, plane.flip * v_signed)
}

/// Gradients by the raw parameters, given those by everything the target view gives.
pub fn geometry_backward(
    p: &Params,
    plane_params: &PlaneParams,
    camera: &Camera,
    background: [f64; 3],
    geometry: &Geometry,
    sources: &[Source],
    v: &Cotangents,
) -> GeometryGrads {
    let mut v_surface = warp_backward(camera, geometry, sources, v);
    for (sum, depth) in v_surface.depth.iter_mut().zip(&v.depth) {
        *sum += depth;
    }
    let blend = blend_backward(camera, background, geometry, &v.base, &v.normal, &v_surface);
    let Geometry { base: forward, planes, .. } = geometry;
    let mut base =
        project_backward_as(p, camera, forward.active_sh_degree, &forward.projected, &blend.splat, forward.model);
    let (mut normals, mut offsets) = (Vec::new(), Vec::new());
    for (i, (plane, v_plane)) in planes.iter().zip(&blend.planes).enumerate() {
        let raw_normal = plane_params.normals[i].into();
        let (v_mean, v_normal, v_offset) = plane_backward(p.means[i].into(), raw_normal, camera, plane, v_plane);
        base.means[i] = (DVec3::from_array(base.means[i]) + v_mean).to_array();
        normals.push(v_normal.to_array());
        offsets.push(v_offset);
    }
    GeometryGrads { base, normals, offsets }
}
