//! Pinhole cameras: the one camera model behind the loaders (distorted photos are undistorted on load).
//!
//! View space follows COLMAP: x right, y down, z forward. Pixel centres lie at `+0.5`: the pixel with
//! column index 0 covers `[0, 1)` and its centre projects to `u = 0.5` (method.md section 2).

use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Largest coordinate of a camera's centre, far beyond what single precision shows, so that no sum overflows.
pub const MAX_COORDINATE: f64 = 1e12;

/// Distances up to this part of a coordinate are rounding.
pub(crate) const ROUNDING: f64 = 1e-14;

/// A posed pinhole camera with its own image size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Focal lengths in pixels (x, y).
    pub focal: DVec2,
    /// Principal point in pixels, pixel centres at +0.5.
    pub principal: DVec2,
    /// Rotation that takes world directions to view directions.
    pub view_from_world: DMat3,
    /// `x_view = view_from_world * x_world + translation`.
    pub translation: DVec3,
}

impl Camera {
    /// Pixels of its image.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Vertical field of view in radians, of a principal point in the middle.
    pub fn vertical_fov(&self) -> f64 {
        2.0 * (0.5 * f64::from(self.height) / self.focal.y).atan()
    }

    /// Camera centre in world space.
    pub fn center(&self) -> DVec3 {
        -(self.view_from_world.transpose() * self.translation)
    }

    /// World point to view space.
    pub fn to_view(&self, world: DVec3) -> DVec3 {
        self.view_from_world * world + self.translation
    }

    /// World point to pixel coordinates and view depth.
    pub fn project(&self, world: DVec3) -> (DVec2, f64) {
        let p = self.to_view(world);
        (self.focal * p.truncate() / p.z + self.principal, p.z)
    }

    /// Pixel coordinates and view depth of a world point that lies in front of the camera and within its image; none of any other,
    /// nor of one that is not finite.
    pub fn seen(&self, world: DVec3) -> Option<(DVec2, f64)> {
        let (at, depth) = self.project(world);
        let within = (0.0..f64::from(self.width)).contains(&at.x) && (0.0..f64::from(self.height)).contains(&at.y);
        (depth > 0.0 && within).then_some((at, depth))
    }

    /// Rotation and translation that take the view space of another camera to this one's.
    pub fn view_from(&self, other: &Camera) -> (DMat3, DVec3) {
        let rotation = self.view_from_world * other.view_from_world.transpose();
        (rotation, self.translation - rotation * other.translation)
    }

    /// Rows of `[R | t]` of [`Camera::view_from`], in single precision.
    pub fn rows_from(&self, other: &Camera) -> [[f32; 4]; 3] {
        let (rotation, translation) = self.view_from(other);
        [0, 1, 2].map(|r| rotation.row(r).extend(translation[r]).as_vec4().to_array())
    }

    /// The way back from [`Camera::project`]: pixel coordinates and view depth to a world point.
    pub fn unproject(&self, uv: DVec2, depth: f64) -> DVec3 {
        let ray = ((uv - self.principal) / self.focal).extend(1.0);
        self.view_from_world.transpose() * (ray * depth - self.translation)
    }

    /// Unit viewing direction in world space through pixel coordinates `uv` (pixel centres at +0.5).
    pub fn ray(&self, uv: DVec2) -> DVec3 {
        let r = (uv - self.principal) / self.focal;
        (self.view_from_world.transpose() * r.extend(1.0)).normalize()
    }

    /// Unit optical axis in world space.
    pub fn forward(&self) -> DVec3 {
        self.view_from_world.transpose() * DVec3::Z
    }

    /// Whether it has the same position and orientation as another one; lens and size do not matter.
    pub fn has_pose_of(&self, other: &Camera) -> bool {
        self.view_from_world == other.view_from_world && self.translation == other.translation
    }

    /// Whether it has the same lens and image size as another one; the pose does not matter.
    pub fn has_lens_of(&self, other: &Camera) -> bool {
        let own = Camera { view_from_world: other.view_from_world, translation: other.translation, ..*self };
        own == *other
    }

    /// The same camera for a photo resized to `width` x `height`.
    pub fn resized(&self, width: u32, height: u32) -> Camera {
        let scale = DVec2::new(f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height));
        Camera { width, height, focal: self.focal * scale, principal: self.principal * scale, ..*self }
    }

    /// The camera of some rows of its image.
    pub fn of_rows(&self, rows: &Range<u32>) -> Camera {
        let principal = self.principal - DVec2::new(0.0, rows.start.into());
        Camera { height: rows.end - rows.start, principal, ..*self }
    }

    /// The same camera with the principal point moved to the image centre (the published code's setting).
    pub fn centred(&self) -> Camera {
        Camera { principal: DVec2::new(f64::from(self.width), f64::from(self.height)) / 2.0, ..*self }
    }
}

/// The views' lenses by number: that of each view, and how many views have each.
pub fn lenses(cameras: &[Camera]) -> (Vec<usize>, Vec<usize>) {
    let mut kinds: Vec<Camera> = Vec::new();
    let (mut lens_of, mut views_of) = (Vec::new(), Vec::new());
    for camera in cameras {
        let same = |kind: &Camera| kind.has_lens_of(camera);
        let lens = kinds.iter().position(same).unwrap_or_else(|| {
            kinds.push(*camera);
            views_of.push(0);
            kinds.len() - 1
        });
        lens_of.push(lens);
        views_of[lens] += 1;
    }
    (lens_of, views_of)
}

/// The cameras next to one of them, at most as many, by where they look and where they stand; the nearest first.
pub fn nearest(cameras: &[Camera], one: usize, most: usize) -> Vec<usize> {
    let extent = usable_extent(scene_extent(cameras.iter()).1);
    let far = |other: usize| {
        let angle = cameras[one].forward().angle_between(cameras[other].forward());
        angle + cameras[one].center().distance(cameras[other].center()) / extent
    };
    let mut others: Vec<(f64, usize)> = (0..cameras.len()).filter(|i| *i != one).map(|i| (far(i), i)).collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    others.into_iter().take(most).map(|(_, other)| other).collect()
}

/// The extent as a unit of length; 1 if all cameras stand at one place, so that their extent is 0.
pub fn usable_extent(extent: f64) -> f64 {
    if extent > 0.0 { extent } else { 1.0 }
}

/// Mean camera position, and the scene extent: 1.1 x the largest distance of a camera from it (method.md section 1); 0 where
/// they differ by rounding alone.
pub fn scene_extent<'a>(cameras: impl Iterator<Item = &'a Camera> + Clone) -> (DVec3, f64) {
    let count = cameras.clone().count().max(1) as f64;
    let mean = cameras.clone().map(Camera::center).sum::<DVec3>() / count;
    let farthest = cameras.map(|c| c.center().distance(mean)).fold(0.0, f64::max);
    let is_rounding = farthest <= ROUNDING * mean.abs().max_element();
    (mean, if is_rounding { 0.0 } else { 1.1 * farthest })
}
