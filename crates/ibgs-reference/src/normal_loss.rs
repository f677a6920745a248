//! Twin of the normal loss (method.md sections 3 and 7) and of its gradients by median depth and normal map.

use glam::DVec3;
use ibgs_data::camera::Camera;
use ibgs_data::camera_change::CameraChange;

use super::camera_gradient::by_ray;
use super::geometry::pixel_ray;
use super::image_loss::Map;

const L1: f64 = 0.4;
const DOT: f64 = 0.6;

/// The four neighbours of an inner pixel: right, left, top, bottom. None on the one-pixel border.
fn neighbours(camera: &Camera, pixel: usize) -> Option<[usize; 4]> {
    let (w, h) = (camera.width as usize, camera.height as usize);
    let (x, y) = (pixel % w, pixel / w);
    let inner = x > 0 && y > 0 && x + 1 < w && y + 1 < h;
    inner.then(|| [pixel + 1, pixel - 1, pixel - w, pixel + w])
}

fn ray(camera: &Camera, pixel: usize) -> DVec3 {
    pixel_ray(camera, pixel as u32 % camera.width, pixel as u32 / camera.width)
}

/// P_right - P_left and P_top - P_bottom.
fn edges(camera: &Camera, depth: &[f64], [right, left, top, bottom]: [usize; 4]) -> [DVec3; 2] {
    let point = |i: usize| ray(camera, i) * depth[i];
    [point(right) - point(left), point(top) - point(bottom)]
}

/// Depth normals in camera space; zero on the border and where the cross product has no length.
pub fn depth_normals(camera: &Camera, depth: &[f64]) -> Map {
    let normal = |pixel: usize| {
        let Some(around) = neighbours(camera, pixel) else { return [0.0; 3] };
        let [a, b] = edges(camera, depth, around);
        a.cross(b).try_normalize().unwrap_or_default().to_array()
    };
    (0..depth.len()).map(normal).collect()
}

/// What the camera sees of the surface, and which pixels its photo masks.
#[derive(Clone, Copy)]
pub struct Surface<'a> {
    pub camera: &'a Camera,
    /// Not masked.
    pub valid: &'a [bool],
}

/// weight (0.4 mean_p sum_c |Nd - N| + 0.6 mean_p (1 - Nd . N)); masked pixels add nothing to the sums.
pub fn normal_loss(surface: Surface, depth: &[f64], normal: &[[f64; 3]], weight: f64) -> f64 {
    let term = |((nd, n), valid): ((&[f64; 3], &[f64; 3]), &bool)| {
        let (nd, n) = (DVec3::from(*nd), DVec3::from(*n));
        if *valid { L1 * (nd - n).abs().element_sum() + DOT * (1.0 - nd.dot(n)) } else { 0.0 }
    };
    let normals = depth_normals(surface.camera, depth);
    weight * normals.iter().zip(normal).zip(surface.valid).map(term).sum::<f64>() / depth.len() as f64
}

/// Gradients of the normal loss.
pub struct NormalGrads {
    pub depth: Vec<f64>,
    pub normal: Map,
    /// By the lens of the camera.
    pub camera: CameraChange,
}

/// Gradients of `normal_loss` by depth, by normal map and by the lens. Where a component of the two normals is equal the absolute
/// difference passes nothing.
pub fn normal_loss_backward(surface: Surface, depth: &[f64], normal: &[[f64; 3]], weight: f64) -> NormalGrads {
    let camera = surface.camera;
    let share = weight / depth.len() as f64;
    let sign = |d: f64| if d == 0.0 { 0.0 } else { d.signum() };
    let mut grads = NormalGrads {
        depth: vec![0.0; depth.len()],
        normal: vec![[0.0; 3]; depth.len()],
        camera: CameraChange::default(),
    };
    for (i, nd) in depth_normals(camera, depth).into_iter().enumerate() {
        if !surface.valid[i] {
            continue;
        }
        let (nd, n) = (DVec3::from(nd), DVec3::from(normal[i]));
        let signs = DVec3::from_array((nd - n).to_array().map(sign));
        grads.normal[i] = (-share * (L1 * signs + DOT * nd)).to_array();
        let Some(around) = neighbours(camera, i).filter(|_| nd != DVec3::ZERO) else { continue };
        let v_nd = share * (L1 * signs - DOT * n);
        let [a, b] = edges(camera, depth, around);
        let v_cross = (v_nd - nd * nd.dot(v_nd)) / a.cross(b).length();
        // d(a x b) . v = da . (b x v) + db . (v x a).
        let (v_a, v_b) = (b.cross(v_cross), v_cross.cross(a));
        for (pixel, v) in around.into_iter().zip([v_a, -v_a, v_b, -v_b]) {
            let ray = ray(camera, pixel);
            grads.depth[pixel] += ray.dot(v);
            grads.camera = grads.camera + by_ray(camera, ray, v * depth[pixel]);
        }
    }
    grads
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finite::assert_gradient;
    use crate::random_scene::{random_camera, random_image};

    #[test]
    fn gradients_agree_with_finite_differences() {
        let camera = random_camera(11, 7, 3);
        let mut depth: Vec<f64> = random_image(11, 7, 2.0, 3.0, 1).iter().map(|v| v[0]).collect();
        let normal = random_image(11, 7, -1.0, 1.0, 2);
        let valid: Vec<bool> = (0..depth.len()).map(|i| i % 7 != 3).collect();
        let seen = Surface { camera: &camera, valid: &valid };
        let v = normal_loss_backward(seen, &depth, &normal, 0.7);
        let by_depth = assert_gradient("depth", &depth, &v.depth, 1e-6, |z| normal_loss(seen, z, &normal, 0.7));
        let by_normal = assert_gradient("normal", normal.as_flattened(), v.normal.as_flattened(), 1e-6, |n| {
            normal_loss(seen, &depth, n.as_chunks().0, 0.7)
        });
        let [pose @ .., a, b, c, d] = v.camera.to_array();
        assert_eq!(pose, [0.0; 6], "the loss is taken in view space");
        let by_lens = assert_gradient("lens", &[0.0; 4], &[a, b, c, d], 1e-6, |lens| {
            let mut change = [0.0; CameraChange::NUMBERS];
            change[6..].copy_from_slice(lens);
            let camera = camera.changed(&CameraChange::from_array(change));
            normal_loss(Surface { camera: &camera, ..seen }, &depth, &normal, 0.7)
        });
        println!("by depth {by_depth:.1e}, by normal {by_normal:.1e}, by lens {by_lens:.1e}");
        // Two pairs without depth: no normal, no gradient.
        for at in [5 * 11 + 4, 5 * 11 + 6, 2 * 11 + 2, 4 * 11 + 2] {
            depth[at] = 0.0;
        }
        let v = normal_loss_backward(seen, &depth, &normal, 0.7);
        assert!(v.depth.iter().all(|v| v.is_finite()));
    }
}
