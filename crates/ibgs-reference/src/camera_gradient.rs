//! Twin of the gradients by the cameras of a target view and of its sources: poses in the tangent space of SE(3) and lenses, see
//! [`CameraChange`]. Thresholds, choices, the sources' depth maps and the directions that the network reads are held fixed.

use glam::{DVec2, DVec3};
use ibgs_data::camera::Camera;
use ibgs_data::camera_change::CameraChange;

use super::geometry::{EPSILON, Geometry, Plane, pixel_ray};
use super::geometry_backward::{Cotangents, PlaneGrad, SurfaceGrads, blend_backward, median_backward, warp_backward};
use super::project::{Splat, covariance_backward, jacobian_backward};
use super::warp::{Pair, Seen, Source, seen_by};
use super::{Forward, Params, SplatGrads, sh};

fn sum(changes: impl Iterator<Item = CameraChange>) -> CameraChange {
    changes.fold(CameraChange::default(), |sum, change| sum + change)
}

/// By a point in view space that moves with the camera.
fn by_point(point: DVec3, v: DVec3) -> CameraChange {
    CameraChange { translation: v, rotation: point.cross(v), ..CameraChange::default() }
}

/// By the lens, of a ray ((x - cx) / fx, (y - cy) / fy, 1).
pub(super) fn by_ray(camera: &Camera, ray: DVec3, v: DVec3) -> CameraChange {
    let v = v.truncate() / camera.focal;
    CameraChange { focal: -v * ray.truncate(), principal: -v, ..CameraChange::default() }
}

/// Through the projection, from the gradients by what the blending reads.
pub fn camera_project(p: &Params, camera: &Camera, forward: &Forward, v: &SplatGrads) -> CameraChange {
    let visible = (0..p.len()).filter(|i| forward.projected[*i].visible);
    sum(visible.map(|i| camera_project_one(p, i, camera, forward, v)))
}

fn camera_project_one(p: &Params, i: usize, camera: &Camera, forward: &Forward, v: &SplatGrads) -> CameraChange {
    let splat = Splat::new(p, i, camera, forward.model).expect("a visible Gaussian projects");
    let z = splat.view.z;
    let v_xy = DVec2::from_array(v.xy[i]);
    let by_plane = v_xy * camera.focal / z;
    let (v_rows, _) = covariance_backward(&splat, v.conic[i]);
    let v_view = by_plane.extend(-by_plane.dot(splat.view.truncate()) / z) + jacobian_backward(&splat, camera, v_rows);
    let mut change = by_point(splat.view, v_view);
    change.focal = v_xy * splat.view.truncate() / z;
    change.principal = v_xy;
    for axis in 0..2 {
        // The row j of J turns against the world: T = J R.
        let row = camera.view_from_world * splat.pixel_from_world[axis];
        let v_row = camera.view_from_world * v_rows[axis];
        change.rotation -= row.cross(v_row);
        // Where the ratio is held its product with the focal length is a constant.
        let by_ratio = if splat.held[axis] { 0.0 } else { splat.ratio[axis] * v_row.z };
        change.focal[axis] += (v_row[axis] - by_ratio) / z;
    }
    // The direction of the colour knows the camera's centre alone, which a turn leaves where it is.
    let (_, v_direction) = sh::color_backward(p.sh_of(i), forward.active_sh_degree, splat.direction, v.color[i]);
    let tangent = v_direction - splat.direction * splat.direction.dot(v_direction);
    change.translation += camera.view_from_world * tangent / splat.distance;
    change
}

/// Through the planes as the camera sees them: n_c = R n, and D_c is the distance of the camera's centre.
pub fn camera_planes(planes: &[Plane], v: &[PlaneGrad]) -> CameraChange {
    sum(planes.iter().zip(v).map(|(plane, v)| CameraChange {
        translation: -plane.normal * plane.sign * v.distance,
        rotation: plane.normal.cross(v.normal),
        ..CameraChange::default()
    }))
}

/// Through the rays that meet the planes, from the gradients by the intersections and the median depth.
pub fn camera_surface(camera: &Camera, geometry: &Geometry, v: &SurfaceGrads) -> CameraChange {
    let pixel = |i: usize| {
        let ray = pixel_ray(camera, i as u32 % camera.width, i as u32 / camera.width);
        let intersections = &geometry.intersections[i];
        let mut v_intersections = v.intersections[i].clone();
        median_backward(intersections, geometry.depth[i], v.depth[i], &mut v_intersections);
        let v_ray = intersections.iter().zip(v_intersections).map(|(met, v)| {
            // z = -D_c / (n_c . r + 1e-8).
            let plane = &geometry.planes[met.gaussian];
            -plane.normal * (v.depth * met.depth / plane.slant(ray))
        });
        by_ray(camera, ray, v_ray.sum())
    };
    sum((0..geometry.depth.len()).map(pixel))
}

/// What a pixel's warping says of the cameras of target and source.
struct BothCameras<'a> {
    target: &'a Camera,
    pair: &'a Pair<'a>,
    ray: DVec3,
    by: [CameraChange; 2],
}

impl BothCameras<'_> {
    /// By a point at a depth on the target's ray: as a point in the source's view space, and as its offset from the target's
    /// centre there.
    fn add(&mut self, depth: f64, v_point: DVec3, v_offset: DVec3) {
        let in_target = self.ray * depth;
        let offset = self.pair.rotation * in_target;
        let point = offset + self.pair.translation;
        self.by[1] = self.by[1] + by_point(point, v_point);
        self.by[1].rotation += offset.cross(v_offset);
        let back = self.pair.rotation.transpose();
        let v_in_target = back * (v_point + v_offset);
        let turned = CameraChange {
            translation: -(back * v_point),
            rotation: -in_target.cross(v_in_target),
            ..CameraChange::default()
        };
        self.by[0] = self.by[0] + turned + by_ray(self.target, self.ray, v_in_target * depth);
    }
}

/// v / (|v| + 1e-8): from the gradient by it to that by v.
fn direction_backward(v: DVec3, by_unit: DVec3) -> DVec3 {
    let length = v.length();
    (by_unit - v * v.dot(by_unit) / (length * (length + EPSILON))) / (length + EPSILON)
}

/// Of one pixel and one source that it sees: by the target's camera and by the source's.
fn seen_camera(
    (target, pair): (&Camera, &Pair),
    (pixel, geometry): (usize, &Geometry),
    seen: &Seen,
    v_warped: [f64; 3],
    v_cosine: f64,
) -> [CameraChange; 2] {
    let ray = pixel_ray(target, pixel as u32 % target.width, pixel as u32 / target.width);
    let mut both = BothCameras { target, pair, ray, by: Default::default() };
    let Camera { focal, .. } = pair.source.camera;
    for (k, landing) in &seen.landings {
        let met = &geometry.intersections[pixel][*k];
        let share = met.weight / seen.weight;
        let slope = landing.read.slope(&pair.source.photo).map(|slope| super::backward::dot(v_warped, slope) * share);
        let v_uv = DVec2::from_array(slope);
        let point = pair.rotation * ray * met.depth + pair.translation;
        let ratio = point.truncate() / point.z;
        let v_ratio = focal * v_uv / point.z;
        both.add(met.depth, v_ratio.extend(-v_ratio.dot(ratio)), DVec3::ZERO);
        both.by[1].focal += v_uv * ratio;
        both.by[1].principal += v_uv;
    }
    let depth = geometry.depth[pixel];
    let offset = pair.rotation * ray * depth;
    let point = offset + pair.translation;
    let unit = |v: DVec3| v / (v.length() + EPSILON);
    both.add(
        depth,
        direction_backward(point, unit(offset) * v_cosine),
        direction_backward(offset, unit(point) * v_cosine),
    );
    both.by
}

/// Through the warping: by the target's camera and by each source's.
pub fn camera_warp(
    camera: &Camera,
    geometry: &Geometry,
    sources: &[Source],
    v: &Cotangents,
) -> (CameraChange, Vec<CameraChange>) {
    let pairs: Vec<Pair> = sources.iter().map(|s| Pair::new(camera, s)).collect();
    let (mut target, mut by_source) = (CameraChange::default(), vec![CameraChange::default(); sources.len()]);
    let pixels = geometry.depth.len();
    for pixel in 0..pixels {
        for (m, (source, seen)) in seen_by(camera, geometry, &pairs, pixel).iter().enumerate() {
            let at = m * pixels + pixel;
            let both = seen_camera((camera, &pairs[*source]), (pixel, geometry), seen, v.warped[at], v.cosine[at]);
            target = target + both[0];
            by_source[*source] = by_source[*source] + both[1];
        }
    }
    (target, by_source)
}

/// By the cameras of the target and of each source, given the gradients by everything that the target view gives.
pub fn camera_gradient(
    p: &Params,
    camera: &Camera,
    background: [f64; 3],
    geometry: &Geometry,
    sources: &[Source],
    v: &Cotangents,
) -> (CameraChange, Vec<CameraChange>) {
    let mut v_surface = warp_backward(camera, geometry, sources, v);
    v_surface.depth.iter_mut().zip(&v.depth).for_each(|(sum, depth)| *sum += depth);
    let blend = blend_backward(camera, background, geometry, &v.base, &v.normal, &v_surface);
    let (by_warp, by_source) = camera_warp(camera, geometry, sources, v);
    let target = camera_project(p, camera, &geometry.base, &blend.splat)
        + camera_planes(&geometry.planes, &blend.planes)
        + camera_surface(camera, geometry, &v_surface)
        + by_warp;
    (target, by_source)
}
