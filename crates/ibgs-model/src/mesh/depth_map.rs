//! What a rendered view says of the surface.

use crate::camera::Camera;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// A pixel's surface, 8 bytes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pixel {
    /// 1 / z of the median depth; 0 where nothing is met or the depth was dropped. On a plane this is linear in the pixel
    /// coordinates.
    pub inverse_depth: f32,
    /// sRGB.
    pub color: [u8; 3],
    /// Cosine of the angle between ray and normal, in 255ths; of a pixel without a depth 255 where nothing is met, 0 where the
    /// depth was dropped.
    pub cosine: u8,
}

impl Pixel {
    /// Free space as far as the view goes.
    const EMPTY: Self = Self { inverse_depth: 0.0, color: [0; 3], cosine: 255 };

    /// Whether the ray meets nothing.
    pub fn is_empty(self) -> bool {
        self.inverse_depth == 0.0 && self.cosine == 255
    }
}

/// Median depths, colours and slants of one view.
#[derive(Clone, Debug)]
pub struct DepthMap {
    pub(crate) camera: Camera,
    /// Row by row.
    pub(crate) pixels: Vec<Pixel>,
}

impl DepthMap {
    /// Keeps the pixels that are seen at less than `max_angle` degrees from their normal.
    ///
    /// `depth` is `[H * W]`, not positive where nothing is met; `rgb` is `[H * W * 3]`, sRGB from 0 to 1. `normals` is
    /// `[H * W * 3]` in camera space, of any length; where it is zero, or absent, the depths of the neighbouring pixels give the
    /// normal.
    ///
    /// # Panics
    /// If a slice is shorter than the camera's image.
    pub fn new(camera: Camera, depth: &[f32], normals: Option<&[f32]>, rgb: &[f32], max_angle: f64) -> Self {
        let least = max_angle.to_radians().cos() as f32;
        let pixel = |i: usize| {
            let z = depth[i];
            if !(z > 0.0 && z.is_finite()) {
                return Pixel::EMPTY;
            }
            let ray = ray(&camera, i);
            let given = normals.map(|n| Vec3::new(n[3 * i], n[3 * i + 1], n[3 * i + 2])).and_then(Vec3::try_normalize);
            let normal = given.or_else(|| normal_of_depths(&camera, depth, i));
            let cosine = normal.map_or(0.0, |normal| -normal.dot(ray) / ray.length());
            if cosine < least.max(0.5 / 255.0) {
                return Pixel::default();
            }
            let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
            let color = [0, 1, 2].map(|c| byte(rgb[3 * i + c]));
            Pixel { inverse_depth: 1.0 / z, color, cosine: byte(cosine) }
        };
        let count = camera.width as usize * camera.height as usize;
        Self { camera, pixels: (0..count).into_par_iter().map(pixel).collect() }
    }

    /// Depth and world point of a pixel; none where there is no surface.
    pub(crate) fn point(&self, index: usize) -> Option<(f32, DVec3)> {
        let inverse = self.pixels[index].inverse_depth;
        let point = || {
            let view = ray(&self.camera, index).as_dvec3() / f64::from(inverse);
            self.camera.view_from_world.transpose() * (view - self.camera.translation)
        };
        (inverse > 0.0).then(|| (1.0 / inverse, point()))
    }

    /// What the view says at pixel coordinates, the first pixel's centre at 0: inverse depth (0 where the ray meets nothing),
    /// and the nearest pixel.
    pub(super) fn read(&self, u: f32, v: f32, truncation: f32) -> Option<(f32, Pixel)> {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        // Between the centres of four pixels.
        if !(u >= 0.0 && v >= 0.0 && u < (width - 1) as f32 && v < (height - 1) as f32) {
            return None;
        }
        let (x, y) = (u as usize, v as usize);
        let (fx, fy) = (u - x as f32, v - y as f32);
        let at = y * width + x;
        let four = [at, at + 1, at + width, at + width + 1].map(|i| self.pixels[i]);
        let nearest = four[usize::from(fx >= 0.5) | usize::from(fy >= 0.5) << 1];
        if nearest.inverse_depth == 0.0 {
            return four.iter().all(|pixel| pixel.is_empty()).then_some((0.0, nearest));
        }
        let [a, b, c, d] = four.map(|pixel| pixel.inverse_depth);
        let (low, high) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        // At an outline a pixel shows only one of its sides, by chance.
        if high - low > truncation * low * high {
            return None;
        }
        let (top, bottom) = (a + fx * (b - a), c + fx * (d - c));
        Some((top + fy * (bottom - top), nearest))
    }
}

/// View-space ray through a pixel's centre, z = 1.
fn ray(camera: &Camera, index: usize) -> Vec3 {
    let (x, y) = (index % camera.width as usize, index / camera.width as usize);
    let at = glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
    ((at - camera.principal) / camera.focal).extend(1.0).as_vec3()
}

/// The normal towards the camera by the nearer neighbour in depth to either side, so that it holds up to an outline.
fn normal_of_depths(camera: &Camera, depth: &[f32], index: usize) -> Option<Vec3> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let (x, y) = (index % width, index / width);
    let point = |i: usize| ray(camera, i) * depth[i];
    let step = |before: Option<usize>, after: Option<usize>| {
        let change = |i: usize| (depth[i] - depth[index]).abs();
        let known = |i: &usize| depth[*i] > 0.0 && depth[*i].is_finite();
        match (before.filter(known), after.filter(known)) {
            (Some(a), Some(b)) if change(a) < change(b) => Some(point(index) - point(a)),
            (_, Some(b)) => Some(point(b) - point(index)),
            (Some(a), None) => Some(point(index) - point(a)),
            (None, None) => None,
        }
    };
    let right = step((x > 0).then(|| index - 1), (x + 1 < width).then_some(index + 1))?;
    let down = step((y > 0).then(|| index.wrapping_sub(width)), (y + 1 < height).then_some(index + width))?;
    // x right, y down, z away: down x right looks at the camera.
    down.cross(right).try_normalize()
}
