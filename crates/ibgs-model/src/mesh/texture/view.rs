//! What a photo says of a point on the surface.

use super::TexturePhoto;
use crate::dataset::Photo;
use crate::mesh::DepthMap;
use glam::{DVec3, Mat3, Vec2, Vec3};

/// Part of a photo's shorter side at its border over which it counts less.
const BORDER: f32 = 0.1;

/// Ratio of the densities at two corners of a triangle up to which it is laid out as a photo shows it.
const MOST_UNEVEN: f32 = 9.0;

/// A photo with the depths that its camera sees.
pub struct View<'a> {
    map: &'a DepthMap,
    photo: &'a Photo,
    rotation: Mat3,
    translation: Vec3,
    /// Focal length and principal point in the photo, pixel centres at +0.5.
    focal: Vec2,
    principal: Vec2,
    size: Vec2,
    /// Pixels of the depth map for one of the photo.
    map_scale: Vec2,
    /// From the photo's exposure to the mean one.
    offset: Vec3,
    gain: Vec3,
    /// Distances from the depth map's surface count up to this.
    tolerance: f32,
}

impl<'a> View<'a> {
    /// For points relative to an origin in the scene.
    pub fn new(map: &'a DepthMap, photo: &'a TexturePhoto, origin: DVec3, tolerance: f64) -> Self {
        let pixels = &*photo.photo;
        let camera = map.camera.resized(pixels.width, pixels.height);
        let size = Vec2::new(pixels.width as f32, pixels.height as f32);
        Self {
            map,
            photo: pixels,
            rotation: camera.view_from_world.as_mat3(),
            translation: camera.to_view(origin).as_vec3(),
            focal: camera.focal.as_vec2(),
            principal: camera.principal.as_vec2(),
            size,
            map_scale: Vec2::new(map.camera.width as f32, map.camera.height as f32) / size,
            offset: photo.exposure.offset.into(),
            gain: Vec3::from(photo.exposure.log_gain.map(|v| (-v).exp())),
            tolerance: tolerance as f32,
        }
    }

    /// A point in view space.
    fn to_view(&self, point: Vec3) -> Vec3 {
        self.rotation * point + self.translation
    }

    /// Pixel coordinates of a point before the camera, pixel centres at +0.5.
    pub fn project(&self, point: Vec3) -> Vec2 {
        let p = self.to_view(point);
        self.focal * p.truncate() / p.z + self.principal
    }

    /// Pixels of the photo for one unit of area of a surface with this normal; not positive where it looks away.
    pub fn density(&self, point: Vec3, normal: Vec3) -> f32 {
        let p = self.to_view(point);
        if p.z > 0.0 { -(self.rotation * normal).dot(p) * self.focal.x * self.focal.y / (p.z * p.z * p.z) } else { 0.0 }
    }

    /// The least density at the corners of a triangle; 0 where it looks away, reaches behind the camera, or is much larger in the
    /// photo at one corner than at another.
    pub fn even_density(&self, corners: [Vec3; 3], normal: Vec3) -> f32 {
        let densities = corners.map(|corner| self.density(corner, normal));
        let (low, high) =
            (densities.iter().copied().fold(f32::INFINITY, f32::min), densities.iter().copied().fold(0.0, f32::max));
        if low > 0.0 && high <= MOST_UNEVEN * low { low } else { 0.0 }
    }

    /// How certain it is that the photo shows the point, from 0 to 1: not beside the image, nor before or behind the surface that
    /// it sees, and less towards the border of the image.
    pub fn sees(&self, point: Vec3) -> f32 {
        let p = self.to_view(point);
        if p.z <= 0.0 {
            return 0.0;
        }
        let at = self.focal * p.truncate() / p.z + self.principal;
        let at_map = at * self.map_scale - 0.5;
        let Some((inverse, pixel)) = self.map.read(at_map.x, at_map.y, 2.0 * self.tolerance) else { return 0.0 };
        // Across the surface, as the fusion measures it.
        let along = (1.0 / inverse - p.z) * (p.length() / p.z);
        let off = along * f32::from(pixel.cosine) / (255.0 * self.tolerance);
        let border = at.min(self.size - at).min_element() / (BORDER * self.size.min_element());
        (1.0 - off * off).max(0.0) * border.clamp(0.0, 1.0)
    }

    /// The colour at a point in the mean exposure, 1 is white; none where a pixel around it is masked.
    pub fn color(&self, point: Vec3) -> Option<Vec3> {
        let at = self.project(point) - 0.5;
        let low = at.floor();
        let part = at - low;
        let last = (self.size - 1.0).as_ivec2();
        let read = |dx: i32, dy: i32| {
            let place = (low.as_ivec2() + glam::IVec2::new(dx, dy)).clamp(glam::IVec2::ZERO, last);
            let first = 4 * (place.y as usize * self.photo.width as usize + place.x as usize);
            let [r, g, b, alpha] = self.photo.rgba[first..first + 4] else { unreachable!("four bytes") };
            (alpha >= 128).then(|| Vec3::new(r.into(), g.into(), b.into()) / 255.0)
        };
        let top = read(0, 0)?.lerp(read(1, 0)?, part.x);
        let bottom = read(0, 1)?.lerp(read(1, 1)?, part.x);
        Some((top.lerp(bottom, part.y) - self.offset) * self.gain)
    }
}
