//! What all cameras move by alike, in the view space of each, is taken back.
//!
//! Held-out cameras cannot follow such a movement: seen from the scene it is another one for each camera, so no common frame has it.

use glam::{DMat3, DQuat, DVec3};
use ibgs_core::camera::Camera;

/// The mean movement of all: rotation vector in radians, shift in units of the cameras.
fn common(first: &[Camera], now: &[Camera]) -> [DVec3; 2] {
    let count = now.len().max(1) as f64;
    let movements = first.iter().zip(now).map(|(first, now)| now.movement_from(first));
    movements.fold([DVec3::ZERO; 2], |[turns, shifts], [turn, shift]| [turns + turn / count, shifts + shift / count])
}

/// Takes the mean movement of all cameras back.
pub fn level(first: &[Camera], cameras: &mut [Camera]) {
    let [turn, shift] = common(first, cameras);
    let back = DQuat::from_scaled_axis(-turn);
    for camera in cameras {
        let center = camera.center() - camera.view_from_world.transpose() * shift;
        let rotation = (back * DQuat::from_mat3(&camera.view_from_world)).normalize();
        camera.view_from_world = DMat3::from_quat(rotation);
        camera.translation = -(camera.view_from_world * center);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use ibgs_core::camera_change::CameraChange;

    fn cameras() -> Vec<Camera> {
        let camera = |i: u32| Camera {
            width: 40,
            height: 30,
            focal: DVec2::splat(30.0),
            principal: DVec2::new(20.0, 15.0),
            view_from_world: DMat3::from_rotation_y(0.7 * f64::from(i)) * DMat3::from_rotation_x(0.1 * f64::from(i)),
            translation: DVec3::new(0.1 * f64::from(i), -0.2, 4.0),
        };
        (0..8).map(camera).collect()
    }

    /// A turn and a shift of the centre in view space.
    fn moved(camera: &Camera, turn: DVec3, shift: DVec3) -> Camera {
        let turned = camera.changed(&CameraChange { rotation: turn, ..CameraChange::default() });
        let center = camera.center() + turned.view_from_world.transpose() * shift;
        Camera { translation: -(turned.view_from_world * center), ..turned }
    }

    fn farthest(a: &[Camera], b: &[Camera]) -> f64 {
        let apart = a.iter().zip(b).map(|(a, b)| {
            let [turn, shift] = b.movement_from(a);
            turn.length().max(shift.length())
        });
        apart.fold(0.0, f64::max)
    }

    const TURN: DVec3 = DVec3::new(0.01, -0.02, 0.005);
    const SHIFT: DVec3 = DVec3::new(0.03, 0.01, -0.02);

    #[test]
    fn what_all_cameras_move_by_alike_is_taken_back() {
        let first = cameras();
        let mut now: Vec<Camera> = first.iter().map(|camera| moved(camera, TURN, SHIFT)).collect();
        assert!(farthest(&first, &now) > 0.02);
        level(&first, &mut now);
        assert!(farthest(&first, &now) < 1e-12, "{}", farthest(&first, &now));
    }

    #[test]
    fn what_a_camera_moves_by_alone_stays() {
        let first = cameras();
        let own = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let alone =
            |by: f64| first.iter().enumerate().map(move |(i, c)| moved(c, by * own(i) * TURN, by * own(i) * SHIFT));
        let mut now: Vec<Camera> = alone(1.0).collect();
        level(&first, &mut now);
        assert!(farthest(&alone(1.0).collect::<Vec<_>>(), &now) < 1e-12, "movements with the mean zero");
        // With a common part on top, up to the second order of the two.
        let both = alone(1.0).map(|camera| moved(&camera, TURN, SHIFT));
        let mut now: Vec<Camera> = both.collect();
        level(&first, &mut now);
        let off = farthest(&alone(1.0).collect::<Vec<_>>(), &now);
        assert!(off < 2e-3, "{off}");
        let [turn, shift] = common(&first, &now);
        assert!(turn.length() < 1e-4 && shift.length() < 1e-12, "{turn} {shift}");
    }

    #[test]
    fn one_camera_stays_where_it_was_and_none_is_no_error() {
        let first = cameras()[..1].to_vec();
        let mut now = vec![moved(&first[0], TURN, SHIFT)];
        level(&first, &mut now);
        assert!(farthest(&first, &now) < 1e-12);
        level(&[], &mut []);
    }
}
