//! Where a camera shows a point, beside where the photo has it.

use crate::camera::Camera;
use glam::{DMat3, DVec2, DVec3};

/// Numbers of a camera that are adjusted: translation and rotation as in [`crate::camera_change::CameraChange`], logarithms of the
/// focal lengths.
pub(super) const NUMBERS: usize = 8;

/// Pixels; an error that is larger, or of a point behind the camera, says nothing else.
pub(super) const FAR: f64 = 1e3;

/// A reprojection error in pixels and its derivatives, by the camera and by the point.
pub(super) struct Reprojection {
    pub error: DVec2,
    pub by_camera: [[f64; NUMBERS]; 2],
    pub by_point: [DVec3; 2],
}

/// The error alone; none where it is [`FAR`].
pub(super) fn error(camera: &Camera, point: DVec3, pixel: DVec2) -> Option<DVec2> {
    let (at, depth) = camera.project(point);
    let error = at - pixel;
    (depth > 0.0 && error.length_squared() < FAR * FAR).then_some(error)
}

impl Reprojection {
    /// None where the error is [`FAR`].
    pub fn of(camera: &Camera, point: DVec3, pixel: DVec2) -> Option<Self> {
        let error = error(camera, point, pixel)?;
        let p = camera.to_view(point);
        let (focal, slope) = (camera.focal / p.z, p.truncate() / p.z);
        let by_view = [DVec3::new(focal.x, 0.0, -focal.x * slope.x), DVec3::new(0.0, focal.y, -focal.y * slope.y)];
        let world_from_view: DMat3 = camera.view_from_world.transpose();
        let row = |i: usize| {
            // The point turns by `rotation x p`.
            let (s, w) = (by_view[i], p.cross(by_view[i]));
            let mut row = [s.x, s.y, s.z, w.x, w.y, w.z, 0.0, 0.0];
            row[6 + i] = camera.focal[i] * slope[i];
            row
        };
        Some(Self { error, by_camera: [row(0), row(1)], by_point: by_view.map(|v| world_from_view * v) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adjust::moved;

    #[test]
    fn derivatives_are_those_of_differences() {
        let camera = Camera {
            width: 400,
            height: 300,
            focal: DVec2::new(300.0, 310.0),
            principal: DVec2::new(190.0, 140.0),
            view_from_world: DMat3::from_rotation_y(0.4) * DMat3::from_rotation_x(-0.9),
            translation: DVec3::new(0.3, -0.7, 2.0),
        };
        let (point, pixel) = (DVec3::new(0.7, 0.2, -0.4), DVec2::new(250.0, 100.0));
        let found = Reprojection::of(&camera, point, pixel).unwrap();
        let step = 1e-6;
        let close = |high: DVec2, low: DVec2, found: [f64; 2]| {
            let difference = (high - low) / (2.0 * step);
            assert!(difference.distance(DVec2::from_array(found)) < 1e-5, "{difference} {found:?}");
            assert!(difference.length() > 1.0);
        };
        for i in 0..NUMBERS {
            let at = |by: f64| {
                let mut change = [0.0; NUMBERS];
                change[i] = by;
                error(&moved(&camera, change), point, pixel).unwrap()
            };
            close(at(step), at(-step), found.by_camera.map(|row| row[i]));
        }
        for i in 0..3 {
            let at = |by: f64| error(&camera, point + DVec3::AXES[i] * by, pixel).unwrap();
            close(at(step), at(-step), found.by_point.map(|row| row[i]));
        }
        assert!(Reprojection::of(&camera, camera.center() - camera.forward(), pixel).is_none());
    }
}
