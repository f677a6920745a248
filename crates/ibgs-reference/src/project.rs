//! Twin of the projection kernel and of its backward pass (method.md section 2).

use glam::{DMat3, DQuat, DVec2, DVec3};
use ibgs_data::camera::Camera;
use rayon::prelude::*;

use super::{BLUR, Grads, MIN_ALPHA, Model, NEAR, Params, Projected, SplatGrads, TILE, sh};

/// One Gaussian after activation, with the intermediate results that the backward pass needs again.
pub(super) struct Splat {
    /// Mean in view space.
    pub(super) view: DVec3,
    /// x/z and y/z held within 1.3 times the tangent of half the field of view.
    pub(super) ratio: DVec2,
    /// Whether either ratio was held: it is then a constant.
    pub(super) held: [bool; 2],
    /// Normalised quaternion and the length it had.
    pub(super) rotation: DQuat,
    pub(super) rotation_length: f64,
    pub(super) scale: DVec3,
    /// Sigma, in world space.
    pub(super) covariance: DMat3,
    /// The two rows of T = J R: pixels by world coordinates.
    pub(super) pixel_from_world: [DVec3; 2],
    /// 2D covariance xx, xy, yy in square pixels, with the blur.
    pub(super) cov2d: [f64; 3],
    pub(super) conic: [f64; 3],
    pub(super) opacity: f64,
    /// Unit direction from the camera centre to the mean, and the distance.
    pub(super) direction: DVec3,
    pub(super) distance: f64,
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// Outer product a b^T.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

impl Splat {
    /// None where the mean is not beyond the near plane or the 2D covariance is not positive.
    pub(super) fn new(p: &Params, i: usize, camera: &Camera, model: Model) -> Option<Splat> {
        let mean = DVec3::from_array(p.means[i]);
        let view = camera.to_view(mean);
        if view.z.is_nan() || view.z <= NEAR {
            return None;
        }
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let limit = 1.3 * size / (2.0 * camera.focal);
        let free = view.truncate() / view.z;
        let ratio = match model {
            Model::Outline | Model::Boxed => free.clamp(-limit, limit),
            Model::Ideal => free,
        };

        let [w, x, y, z] = p.rotations[i];
        let raw = DQuat::from_xyzw(x, y, z, w);
        let rotation = raw * (1.0 / raw.length());
        let scale = DVec3::from_array(p.log_scales[i]).exp();
        let axes = rotation_matrix(rotation) * DMat3::from_diagonal(scale);
        let covariance = axes * axes.transpose();

        let world_from_view = camera.view_from_world.transpose();
        let [j0, j1] = jacobian(camera, view.z, ratio);
        let pixel_from_world = [world_from_view * j0, world_from_view * j1];
        let [t0, t1] = pixel_from_world;
        let cov2d = [t0.dot(covariance * t0) + BLUR, t0.dot(covariance * t1), t1.dot(covariance * t1) + BLUR];
        let det = cov2d[0] * cov2d[2] - cov2d[1] * cov2d[1];
        // Zero, negative or NaN by rounding, or beyond f32.
        if !(det > 0.0 && det <= f64::from(f32::MAX)) {
            return None;
        }
        let offset = mean - camera.center();
        let distance = offset.length();
        Some(Splat {
            view,
            ratio,
            held: [free.x != ratio.x, free.y != ratio.y],
            rotation,
            rotation_length: raw.length(),
            scale,
            covariance,
            pixel_from_world,
            cov2d,
            conic: [cov2d[2] / det, -cov2d[1] / det, cov2d[0] / det],
            opacity: sigmoid(p.opacity_logits[i]),
            direction: offset / distance,
            distance,
        })
    }

    /// Half sides of a box around the outline, where alpha is 1/255, with some room: what tiles cut off must not be seen.
    fn outline(&self) -> [f64; 2] {
        let cut = 2.0 * ((self.opacity / MIN_ALPHA).ln().max(0.0) + 0.05);
        [self.cov2d[0], self.cov2d[2]].map(|variance| (cut * variance).sqrt() + 2.0)
    }

    /// ceil(3 sqrt(largest eigenvalue)), with the discriminant held from below as in 3DGS.
    fn radius(&self) -> f64 {
        let [xx, xy, yy] = self.cov2d;
        let mid = 0.5 * (xx + yy);
        let det = xx * yy - xy * xy;
        (3.0 * (mid + (mid * mid - det).max(0.1).sqrt()).sqrt()).ceil()
    }
}

/// Rotation matrix of a unit quaternion; glam's own asserts that the length is one, which poisoned scenes violate.
fn rotation_matrix(q: DQuat) -> DMat3 {
    let DQuat { x, y, z, w } = q;
    DMat3::from_cols(
        DVec3::new(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        DVec3::new(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        DVec3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
}

/// Rows of the Jacobian of the projection by view coordinates, at the held ratios.
fn jacobian(camera: &Camera, z: f64, ratio: DVec2) -> [DVec3; 2] {
    let f = camera.focal / z;
    [DVec3::new(f.x, 0.0, -f.x * ratio.x), DVec3::new(0.0, f.y, -f.y * ratio.y)]
}

/// Tiles touched by the rectangle of these half sides around `xy` (reference.py truncates towards zero before clamping).
fn tile_rect(xy: [f64; 2], half: [f64; 2], camera: &Camera) -> [u32; 4] {
    let tile = f64::from(TILE);
    let range = |center: f64, radius: f64, size: u32| {
        let tiles = size.div_ceil(TILE);
        let clamp = |v: f64| (v as i64).clamp(0, i64::from(tiles)) as u32;
        (clamp((center - radius) / tile), clamp((center + radius + tile - 1.0) / tile))
    };
    let (x0, x1) = range(xy[0], half[0], camera.width);
    let (y0, y1) = range(xy[1], half[1], camera.height);
    [x0, y0, x1, y1]
}

/// A Gaussian is invisible as soon as one of its numbers is not a finite f32.
fn finite(p: &Projected) -> bool {
    let numbers = [p.depth, p.opacity, p.radius].into_iter();
    let mut numbers = numbers.chain(p.xy).chain(p.conic).chain(p.color);
    numbers.all(|v| (v as f32).is_finite())
}

fn project_one(p: &Params, i: usize, camera: &Camera, active_sh_degree: usize, model: Model) -> Option<Projected> {
    let splat = Splat::new(p, i, camera, model)?;
    let uv = camera.focal * splat.view.truncate() / splat.view.z + camera.principal;
    let xy = (uv - 0.5).to_array();
    let radius = splat.radius();
    let mut projected = Projected {
        visible: true,
        xy,
        depth: splat.view.z,
        conic: splat.conic,
        opacity: splat.opacity,
        color: sh::color(p.sh_of(i), active_sh_degree, splat.direction),
        rect: match model {
            Model::Boxed => tile_rect(xy, [radius; 2], camera),
            Model::Outline | Model::Ideal => tile_rect(xy, splat.outline(), camera),
        },
        radius,
    };
    let [x0, y0, x1, y1] = projected.rect;
    if !finite(&projected) || x0 >= x1 || y0 >= y1 {
        return None;
    }
    // Clamped only here: the clamp would hide a colour that is NaN or minus infinity.
    projected.color = projected.color.map(|c| c.max(0.0));
    Some(projected)
}

/// Projects every Gaussian; only the first `active_sh_degree` degrees of the colour count.
pub fn project(p: &Params, camera: &Camera, active_sh_degree: usize) -> Vec<Projected> {
    project_as(p, camera, active_sh_degree, Model::Outline)
}

/// `project` with a choice of the model.
pub fn project_as(p: &Params, camera: &Camera, active_sh_degree: usize, model: Model) -> Vec<Projected> {
    assert!(active_sh_degree <= p.sh_degree, "an active degree that is not stored");
    let one = |i| project_one(p, i, camera, active_sh_degree, model).unwrap_or_default();
    (0..p.len()).into_par_iter().map(one).collect()
}

/// Gradients of one Gaussian by its raw parameters.
#[derive(Default)]
struct OneGrad {
    mean: [f64; 3],
    rotation: [f64; 4],
    log_scale: [f64; 3],
    opacity_logit: f64,
    sh: Vec<f64>,
}

/// Carries the blending's gradients on to the raw parameters. An invisible Gaussian gets zeros.
pub fn project_backward(
    p: &Params,
    camera: &Camera,
    active_sh_degree: usize,
    projected: &[Projected],
    v: &SplatGrads,
) -> Grads {
    project_backward_as(p, camera, active_sh_degree, projected, v, Model::Outline)
}

/// `project_backward` with a choice of the model, the one of the projection.
pub fn project_backward_as(
    p: &Params,
    camera: &Camera,
    active_sh_degree: usize,
    projected: &[Projected],
    v: &SplatGrads,
    model: Model,
) -> Grads {
    let one = |i: usize| match projected[i].visible {
        true => project_backward_one(p, i, camera, active_sh_degree, v, model),
        false => OneGrad { sh: vec![0.0; p.sh_of(i).len()], ..OneGrad::default() },
    };
    let all: Vec<OneGrad> = (0..p.len()).into_par_iter().map(one).collect();
    Grads {
        means: all.iter().map(|g| g.mean).collect(),
        rotations: all.iter().map(|g| g.rotation).collect(),
        log_scales: all.iter().map(|g| g.log_scale).collect(),
        opacity_logits: all.iter().map(|g| g.opacity_logit).collect(),
        sh: all.iter().flat_map(|g| g.sh.iter().copied()).collect(),
        xy: v.xy.clone(),
        xy_abs: v.xy_abs.clone(),
    }
}

fn project_backward_one(
    p: &Params,
    i: usize,
    camera: &Camera,
    active_sh_degree: usize,
    v: &SplatGrads,
    model: Model,
) -> OneGrad {
    let splat = Splat::new(p, i, camera, model).expect("a visible Gaussian projects");
    let z = splat.view.z;

    // Projected mean: u = f x / z + c.
    let v_xy = DVec2::from_array(v.xy[i]);
    let by_plane = v_xy * camera.focal / z;
    let mut v_view = by_plane.extend(-by_plane.dot(splat.view.truncate()) / z);

    let (v_pixel_from_world, v_covariance) = covariance_backward(&splat, v.conic[i]);
    v_view += jacobian_backward(&splat, camera, v_pixel_from_world);
    let (rotation, log_scale) = shape_backward(&splat, v_covariance);

    let (sh, v_direction) = sh::color_backward(p.sh_of(i), active_sh_degree, splat.direction, v.color[i]);
    let tangent = v_direction - splat.direction * splat.direction.dot(v_direction);
    let v_mean = camera.view_from_world.transpose() * v_view + tangent / splat.distance;
    OneGrad {
        mean: v_mean.to_array(),
        rotation,
        log_scale,
        opacity_logit: v.opacity[i] * splat.opacity * (1.0 - splat.opacity),
        sh,
    }
}

/// From the conic to the rows of T and to Sigma: cov2d = T Sigma T^T + blur, conic = cov2d^-1.
pub(super) fn covariance_backward(splat: &Splat, v_conic: [f64; 3]) -> ([DVec3; 2], DMat3) {
    // d(X^-1) = -X^-1 dX X^-1 with the symmetric X = cov2d; the off-diagonal gradient is shared by both entries.
    let [a, b, c] = splat.conic;
    let [va, vb, vc] = [v_conic[0], 0.5 * v_conic[1], v_conic[2]];
    let m00 = -(a * a * va + 2.0 * a * b * vb + b * b * vc);
    let m01 = -(a * b * va + (a * c + b * b) * vb + b * c * vc);
    let m11 = -(b * b * va + 2.0 * b * c * vb + c * c * vc);
    let [t0, t1] = splat.pixel_from_world;
    let (s0, s1) = (splat.covariance * t0, splat.covariance * t1);
    let v_rows = [2.0 * (s0 * m00 + s1 * m01), 2.0 * (s0 * m01 + s1 * m11)];
    let v_covariance = outer(t0, t0) * m00 + (outer(t0, t1) + outer(t1, t0)) * m01 + outer(t1, t1) * m11;
    (v_rows, v_covariance)
}

/// From the rows of T = J R to the mean in view space. A held ratio is a constant.
pub(super) fn jacobian_backward(splat: &Splat, camera: &Camera, v_rows: [DVec3; 2]) -> DVec3 {
    let z = splat.view.z;
    let mut v_view = DVec3::ZERO;
    for axis in 0..2 {
        // The row is f/z at `axis` and -f ratio / z at 2.
        let v_row = camera.view_from_world * v_rows[axis];
        let (f, ratio) = (camera.focal[axis], splat.ratio[axis]);
        v_view.z -= f * (v_row[axis] - v_row.z * ratio) / (z * z);
        if !splat.held[axis] {
            let v_ratio = -f * v_row.z / z;
            v_view[axis] += v_ratio / z;
            v_view.z -= v_ratio * ratio / z;
        }
    }
    v_view
}

/// From Sigma = (R S)(R S)^T to the raw quaternion (w, x, y, z) and the logarithmic scales.
fn shape_backward(splat: &Splat, v_covariance: DMat3) -> ([f64; 4], [f64; 3]) {
    let rotation = rotation_matrix(splat.rotation);
    let axes = rotation * DMat3::from_diagonal(splat.scale);
    let v_axes = v_covariance * axes * 2.0;
    let v_log_scale: [f64; 3] = std::array::from_fn(|j| v_axes.col(j).dot(rotation.col(j)) * splat.scale[j]);
    let g = v_axes * DMat3::from_diagonal(splat.scale);
    let (g0, g1, g2) = (g.x_axis, g.y_axis, g.z_axis);

    // Entry (row r, column c) of the gradient by the rotation matrix is gc[r].
    let DQuat { x, y, z, w } = splat.rotation;
    let v_unit = 2.0
        * glam::DVec4::new(
            x * (g1.z - g2.y) + y * (g2.x - g0.z) + z * (g0.y - g1.x),
            -2.0 * x * (g1.y + g2.z) + y * (g1.x + g0.y) + z * (g2.x + g0.z) + w * (g1.z - g2.y),
            x * (g1.x + g0.y) - 2.0 * y * (g0.x + g2.z) + z * (g2.y + g1.z) + w * (g2.x - g0.z),
            x * (g2.x + g0.z) + y * (g2.y + g1.z) - 2.0 * z * (g0.x + g1.y) + w * (g0.y - g1.x),
        );
    let unit = glam::DVec4::new(w, x, y, z);
    let v_raw = (v_unit - unit * unit.dot(v_unit)) / splat.rotation_length;
    (v_raw.to_array(), v_log_scale)
}
