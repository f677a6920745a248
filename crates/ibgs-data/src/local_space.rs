//! Local coordinates, which make results independent of a scene's unit and position.
//!
//! Doubles (cameras, points, camera paths, whatever a user sees) are in the scene's own coordinates. Single precision
//! (Gaussians, depth maps, everything on the device) is in *local* coordinates: the scene moved to the origin and scaled so
//! that the extent of its cameras is about [`EXTENT`]. The near plane and float32 then suit every scene, and a training sees
//! the same numbers in any unit and at any place of its scene. [`Gaussians`](crate::scene::Gaussians) and
//! `Splats` carry their [`LocalSpace`]; trainer and renderer convert cameras to it.

use crate::camera::{Camera, ROUNDING};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Extent of the cameras (method.md section 1) in local units; that of a usual COLMAP model.
pub const EXTENT: f64 = 5.0;

/// The extent is 1.1 times the largest distance from the middle.
const EXTENT_OVER_DISTANCE: f64 = 1.1;
/// Part of the cameras that set the scale; those beyond may be wrongly posed.
const PART: f64 = 0.9;
/// Median distance of points from their middle, in local units, where there are no cameras to measure by.
const POINT_DISTANCE: f64 = 10.0;
/// Least scale: coordinates of up to 1e12 keep far from the largest float.
const MIN_SCALE: f64 = 1e-20;
/// From this many local units on, files keep an offset: float32 would shift what lies there by 1e-5 of the extent.
const FAR: f64 = 1000.0;

/// Moves and scales, without a turn: local = (scene - origin) / scale.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LocalSpace {
    /// Scene coordinates of the local origin.
    pub origin: DVec3,
    /// Scene units of one local unit.
    pub scale: f64,
}

impl Default for LocalSpace {
    /// Local coordinates that are the scene's.
    fn default() -> Self {
        Self::at(DVec3::ZERO)
    }
}

impl LocalSpace {
    /// Moved, but not scaled.
    pub fn at(origin: DVec3) -> Self {
        Self { origin, scale: 1.0 }
    }

    /// The local space of a scene: from all its cameras, held-out ones included, or from its points if all cameras
    /// stand at one place.
    pub fn of_scene<'a>(cameras: impl Iterator<Item = &'a Camera>, points: impl Iterator<Item = DVec3>) -> Self {
        Self::of_cameras(cameras).or_else(|| Self::of_points(points)).unwrap_or_default()
    }

    /// From the positions of cameras: nine tenths of them lie within the extent around their median. None if all stand
    /// at one place.
    pub fn of_cameras<'a>(cameras: impl Iterator<Item = &'a Camera>) -> Option<Self> {
        let centers: Vec<DVec3> = cameras.map(Camera::center).filter(|center| center.is_finite()).collect();
        let origin = median_place(&centers)?;
        let least = ROUNDING * centers.iter().map(|center| center.abs().max_element()).fold(0.0, f64::max);
        let distances = sorted(centers.iter().map(|center| center.distance(origin)));
        let at = (PART * (distances.len() - 1) as f64) as usize;
        let distance = [distances[at], distances[distances.len() - 1]].into_iter().find(|&d| d > least)?;
        Self::usable(origin, EXTENT_OVER_DISTANCE * distance / EXTENT)
    }

    /// From points: the scale is their median distance from their median position. None if most of them lie at one
    /// place.
    pub fn of_points(points: impl Iterator<Item = DVec3>) -> Option<Self> {
        let points: Vec<DVec3> = points.filter(|point| point.is_finite()).collect();
        let origin = median_place(&points)?;
        let distance = middle(&sorted(points.iter().map(|point| point.distance(origin))));
        let is_rounding = distance <= ROUNDING * origin.abs().max_element();
        if is_rounding { None } else { Self::usable(origin, distance / POINT_DISTANCE) }
    }

    /// The same with another extent of the cameras, in scene units; as it is without one.
    pub fn with_extent(self, extent: Option<f64>) -> Self {
        let usable = extent.and_then(|extent| Self::usable(self.origin, extent / EXTENT));
        usable.unwrap_or(self)
    }

    fn usable(origin: DVec3, scale: f64) -> Option<Self> {
        (scale >= MIN_SCALE && scale.is_finite()).then_some(Self { origin, scale })
    }

    /// The extent of the cameras, in scene units.
    pub fn extent(&self) -> f64 {
        self.scale * EXTENT
    }

    /// A point of the scene in local coordinates.
    pub fn to_local(&self, scene: DVec3) -> DVec3 {
        (scene - self.origin) / self.scale
    }

    /// A local point in the scene's coordinates.
    pub fn to_scene(&self, local: DVec3) -> DVec3 {
        local * self.scale + self.origin
    }

    /// A camera of the scene in local coordinates: it shows the same picture of the same things.
    pub fn camera(&self, scene: &Camera) -> Camera {
        let translation = (scene.view_from_world * self.origin + scene.translation) / self.scale;
        Camera { translation, ..*scene }
    }

    /// The way back from [`LocalSpace::camera`].
    pub fn scene_camera(&self, local: &Camera) -> Camera {
        let translation = local.translation * self.scale - local.view_from_world * self.origin;
        Camera { translation, ..*local }
    }

    /// Whether float32 holds the scene's coordinates as well as the local ones.
    pub fn is_near(&self) -> bool {
        self.origin.abs().max_element() <= FAR * self.scale
    }

    /// The offset of coordinates in single-precision files, if the scene lies too far from its origin for them: a
    /// rounded position near the local origin. A space that is moved but not scaled, as read from a file, keeps its
    /// offset.
    pub fn file_offset(&self) -> Option<DVec3> {
        if self.scale == 1.0 {
            return Some(self.origin).filter(|&origin| origin != DVec3::ZERO);
        }
        if self.is_near() {
            return None;
        }
        // Whole steps of a power of ten below the extent. Dividing by a whole number keeps the decimals few.
        let exponent = (EXTENT * self.scale).log10().floor() as i32;
        let step = 10_f64.powi(exponent.abs());
        Some(match exponent >= 0 {
            true => (self.origin / step).round() * step,
            false => (self.origin * step).round() / step,
        })
    }
}

/// A length in scene units, rounded for display.
#[derive(Clone, Copy, Debug)]
pub struct Length(pub f64);

impl fmt::Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(value) = self;
        if *value != 0.0 && value.abs() < 1e-3 { write!(f, "{value:.3e}") } else { write!(f, "{value:.4}") }
    }
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// The middle value, or the mean of both. There is at least one.
fn middle(sorted: &[f64]) -> f64 {
    let last = sorted.len() - 1;
    sorted[last / 2] + 0.5 * (sorted[last.div_ceil(2)] - sorted[last / 2])
}

/// The median on each axis; none without places.
fn median_place(places: &[DVec3]) -> Option<DVec3> {
    let axis = |axis: usize| middle(&sorted(places.iter().map(|place| place[axis])));
    (!places.is_empty()).then(|| DVec3::new(axis(0), axis(1), axis(2)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::scene_extent;
    use glam::{DMat3, DQuat, DVec2};

    /// A ring of cameras that looks at its middle.
    fn ring(count: u32, at: DVec3, radius: f64) -> Vec<Camera> {
        let camera = |i: u32| {
            let turn = DQuat::from_euler(glam::EulerRot::YXZ, f64::from(i) * 1.3, 0.3, 0.1);
            let view_from_world = DMat3::from_quat(turn.inverse());
            let center = at + turn * DVec3::NEG_Z * radius;
            let (focal, principal) = (DVec2::splat(50.0), DVec2::splat(32.0));
            let translation = -(view_from_world * center);
            Camera { width: 64, height: 64, focal, principal, view_from_world, translation }
        };
        (0..count).map(camera).collect()
    }

    #[test]
    fn every_scale_and_place_gives_the_same_local_cameras() {
        let local = |cameras: &[Camera]| -> Vec<Camera> {
            let space = LocalSpace::of_cameras(cameras.iter()).unwrap();
            cameras.iter().map(|camera| space.camera(camera)).collect()
        };
        let usual = local(&ring(20, DVec3::new(1.0, -2.0, 0.5), 3.0));
        assert!((scene_extent(usual.iter()).1 - EXTENT).abs() < 0.6, "{}", scene_extent(usual.iter()).1);
        for scale in [1e-4, 0.5, 30.0, 1e4] {
            for shift in [DVec3::ZERO, DVec3::new(5e6, -4e6, 1e5)] {
                let moved = local(&ring(20, DVec3::new(1.0, -2.0, 0.5) * scale + shift, 3.0 * scale));
                // A double has this many digits left at that place.
                let tolerance = 1e-9_f64.max(1e-14 * shift.length() / scale);
                for (a, b) in usual.iter().zip(&moved) {
                    assert!(a.center().distance(b.center()) < tolerance, "{scale} {shift}");
                    assert_eq!(a.view_from_world, b.view_from_world);
                }
            }
        }
        // A power of two changes no bit.
        assert_eq!(usual, local(&ring(20, DVec3::new(1.0, -2.0, 0.5) * 8.0, 24.0)));
    }

    #[test]
    fn a_camera_shows_the_same_picture() {
        let cameras = ring(9, DVec3::new(700.0, 5.0, -40.0), 25.0);
        let space = LocalSpace::of_cameras(cameras.iter()).unwrap();
        let point = DVec3::new(702.0, 4.0, -41.0);
        assert!(space.to_scene(space.to_local(point)).distance(point) < 1e-12);
        for camera in &cameras {
            let (there, depth) = camera.project(point);
            let (here, local_depth) = space.camera(camera).project(space.to_local(point));
            assert!(here.distance(there) < 1e-9 && (local_depth * space.scale - depth).abs() < 1e-9);
        }
    }

    #[test]
    fn a_lost_camera_does_not_set_the_scale() {
        let mut cameras = ring(20, DVec3::ZERO, 3.0);
        let usual = LocalSpace::of_cameras(cameras.iter()).unwrap();
        cameras.extend(ring(1, DVec3::splat(1e6), 3.0));
        let found = LocalSpace::of_cameras(cameras.iter()).unwrap();
        assert!((0.8..1.25).contains(&(found.scale / usual.scale)), "{found:?}");
        assert!(found.origin.distance(usual.origin) < 1.0);
    }

    #[test]
    fn cameras_at_one_place_leave_it_to_the_points() {
        let tripod = ring(12, DVec3::new(5e6, 3.0, -8.0), 0.0);
        assert_eq!(LocalSpace::of_cameras(tripod.iter()), None);
        let points = ring(30, DVec3::new(5e6, 3.0, -8.0), 4.0);
        let space = LocalSpace::of_scene(tripod.iter(), points.iter().map(Camera::center));
        assert!((0.2..0.6).contains(&space.scale) && space.origin.distance(tripod[0].center()) < 4.0, "{space:?}");
        for points in [vec![], vec![DVec3::ONE; 7], vec![DVec3::NAN]] {
            assert_eq!(LocalSpace::of_scene(tripod.iter(), points.into_iter()), LocalSpace::default());
        }
    }

    #[test]
    fn offsets_are_round_and_near() {
        let space = |origin: [f64; 3], scale: f64| LocalSpace { origin: origin.into(), scale };
        assert_eq!(space([900.0, 0.0, 0.0], 1.5).file_offset(), None);
        assert_eq!(space([8e3, -9e3, 3.0], 10.0).file_offset(), None);
        let cases = [
            (space([5_000_123.4, -40.2, 17.0], 1.5), [5_000_123.0, -40.0, 17.0]),
            (space([5.4, 0.0, 0.0], 1.0), [5.4, 0.0, 0.0]),
            (space([5_000_123.4, -40.2, 17.0], 20.0), [5_000_100.0, 0.0, 0.0]),
            (space([5.123_456, 0.0, -0.1], 0.001), [5.123, 0.0, -0.1]),
        ];
        for (space, expected) in cases {
            assert_eq!(space.file_offset(), Some(expected.into()));
            assert!(space.to_local(expected.into()).abs().max_element() <= EXTENT);
        }
    }
}
