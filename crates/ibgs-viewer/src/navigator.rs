//! The camera in the user's hand: it orbits a point, looks around, pans, zooms and flies. Knows nothing of windows.

use glam::{DMat3, DVec2, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::camera_path::Keyframe;
use ibgs_core::similarity::Similarity;

/// Least angle between the optical axis and the up axis when orbiting, in radians.
const POLE: f64 = 0.05;
/// Usual vertical field of view where no view has one, in radians.
const USUAL_FOV: f64 = 0.9;

/// Where the camera stands and what it turns about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Navigator {
    /// Camera centre in world space.
    pub position: DVec3,
    /// View axes in world space as columns: right, down, forward.
    pub world_from_view: DMat3,
    /// Distance of the point that orbits go around, along the optical axis.
    pub distance: f64,
    /// The distance at first, by which others are small or large.
    pub size: f64,
    /// Up in world space, of length one.
    pub up: DVec3,
    /// Vertical field of view in radians, of a picture of the shape below.
    pub fov: f64,
    /// Width over height of that picture; it is the largest one of its shape in the middle of the image.
    pub shape: f64,
}

/// Moves of one frame, in units of the view: right, down, forward.
pub type Step = DVec3;

impl Navigator {
    /// Stands where `camera` stands. Orbits go around the point of the axis that is nearest to `center`.
    pub fn at(camera: &Camera, center: DVec3, up: DVec3) -> Self {
        let forward = camera.forward();
        let ahead = (center - camera.center()).dot(forward);
        let apart = camera.center().distance(center);
        let usual = if apart > 0.0 { apart } else { 1.0 };
        let distance = if ahead > 0.1 * usual { ahead } else { usual };
        Self {
            position: camera.center(),
            world_from_view: camera.view_from_world.transpose(),
            distance,
            size: distance,
            up,
            fov: camera.vertical_fov(),
            shape: f64::from(camera.width) / f64::from(camera.height),
        }
    }

    /// Looks at `center` from `distance` away, for scenes without any camera.
    pub fn facing(center: DVec3, distance: f64) -> Self {
        let up = DVec3::NEG_Y;
        Self {
            position: center - DVec3::Z * distance,
            world_from_view: DMat3::IDENTITY,
            distance,
            size: distance,
            up,
            fov: USUAL_FOV,
            shape: 1.0,
        }
    }

    fn right(&self) -> DVec3 {
        self.world_from_view.x_axis
    }

    fn forward(&self) -> DVec3 {
        self.world_from_view.z_axis
    }

    /// The point that orbits go around.
    pub fn pivot(&self) -> DVec3 {
        self.position + self.forward() * self.distance
    }

    /// Where it stands, as a keyframe.
    pub fn keyframe(&self) -> Keyframe {
        Keyframe { position: self.position, world_from_view: self.world_from_view, fov: self.fov, way: 1.0 }
    }

    /// Stands where a keyframe does; the pivot stays as far ahead.
    pub fn follow(&mut self, key: &Keyframe) {
        (self.position, self.world_from_view, self.fov) = (key.position, key.world_from_view, key.fov);
    }

    /// The camera for an image of this size, its principal point in the middle.
    pub fn camera(&self, width: u32, height: u32) -> Camera {
        // A narrow image has more above and below, as around a view.
        let more = (self.shape * f64::from(height) / f64::from(width)).max(1.0);
        let fov = 2.0 * ((0.5 * self.fov).tan() * more).atan();
        Keyframe { fov, ..self.keyframe() }.camera(width, height)
    }

    /// Turned by `yaw` about the up axis and by `pitch` about its own right axis, but never over a pole.
    fn turned(&self, yaw: f64, pitch: f64) -> DMat3 {
        let yawed = DMat3::from_axis_angle(self.up, yaw) * self.world_from_view;
        let angle = yawed.z_axis.angle_between(self.up);
        // A positive turn about the right axis raises the view: it makes that angle smaller.
        let pitch = pitch.clamp((angle - (std::f64::consts::PI - POLE)).min(0.0), (angle - POLE).max(0.0));
        let turned = DMat3::from_axis_angle(yawed.x_axis, pitch) * yawed;
        // Rounding adds up over many turns.
        let forward = turned.z_axis.normalize();
        let right = (turned.x_axis - forward * forward.dot(turned.x_axis)).normalize();
        DMat3::from_cols(right, forward.cross(right), forward)
    }

    /// Orbits the pivot by an angle in radians.
    pub fn orbit(&mut self, yaw: f64, pitch: f64) {
        let pivot = self.pivot();
        self.world_from_view = self.turned(yaw, pitch);
        self.position = pivot - self.forward() * self.distance;
    }

    /// Turns in place by an angle in radians.
    pub fn look(&mut self, yaw: f64, pitch: f64) {
        self.world_from_view = self.turned(yaw, pitch);
    }

    /// Moves sideways: the pivot follows the pointer, `delta` in heights of the picture, x right, y down.
    pub fn pan(&mut self, delta: DVec2) {
        let height = 2.0 * self.distance * (0.5 * self.fov).tan();
        self.position -= (self.right() * delta.x + self.world_from_view.y_axis * delta.y) * height;
    }

    /// Goes nearer to the pivot (`steps` > 0) or away from it.
    pub fn zoom(&mut self, steps: f64) {
        self.scale(0.85f64.powf(-steps));
    }

    /// Moves towards the pivot so that it looks larger by a factor.
    pub fn scale(&mut self, factor: f64) {
        let pivot = self.pivot();
        self.distance = (self.distance / factor).clamp(1e-4 * self.size, 1e6 * self.size);
        self.position = pivot - self.forward() * self.distance;
    }

    /// Flies; the pivot comes along.
    pub fn fly(&mut self, step: Step) {
        self.position += self.world_from_view * step;
    }

    /// Moves, turns and goes nearer or farther as a similarity takes it.
    pub fn place(&mut self, by: &Similarity) {
        self.position = by.point(self.position);
        self.world_from_view = by.rotation * self.world_from_view;
        self.up = by.rotation * self.up;
        (self.distance, self.size) = (by.scale * self.distance, by.scale * self.size);
    }

    /// Turns to a point and orbits around it from now on.
    pub fn focus(&mut self, point: DVec3) {
        let offset = point - self.position;
        if !(offset.length() > 1e-6 * self.size && offset.is_finite()) {
            return;
        }
        let forward = offset.normalize();
        let side = forward.cross(self.up);
        let right = if side.length() > 1e-3 { side.normalize() } else { self.right() };
        self.world_from_view = DMat3::from_cols(right, forward.cross(right), forward);
        self.distance = offset.length();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn navigator() -> Navigator {
        let mut navigator = Navigator::facing(DVec3::new(1.0, 2.0, 3.0), 4.0);
        navigator.orbit(0.3, 0.2);
        navigator
    }

    fn is_rotation(m: DMat3) -> bool {
        (m.transpose() * m).abs_diff_eq(DMat3::IDENTITY, 1e-9) && (m.determinant() - 1.0).abs() < 1e-9
    }

    #[test]
    fn orbits_keep_the_pivot_in_the_middle() {
        let mut n = navigator();
        let pivot = n.pivot();
        for _ in 0..1000 {
            n.orbit(0.1, 0.03);
        }
        n.zoom(3.0);
        assert!(n.pivot().abs_diff_eq(pivot, 1e-6) && is_rotation(n.world_from_view));
        assert!((n.distance - 4.0 * 0.85f64.powi(3)).abs() < 1e-9);
        let camera = n.camera(640, 480);
        let (at, depth) = camera.project(pivot);
        assert!(at.abs_diff_eq(DVec2::new(320.0, 240.0), 1e-6) && (depth - n.distance).abs() < 1e-6);
        // Not over the pole, however far it is pulled; the horizon stays level.
        n.orbit(0.0, 100.0);
        assert!((n.forward().angle_between(n.up) - POLE).abs() < 1e-6);
        n.orbit(0.0, -100.0);
        assert!((n.forward().angle_between(-n.up) - POLE).abs() < 1e-6);
        assert!(n.right().dot(n.up).abs() < 1e-6);
    }

    #[test]
    fn looking_and_flying_leave_what_they_should() {
        let mut n = navigator();
        let (position, forward) = (n.position, n.forward());
        n.look(0.2, -0.1);
        assert!(n.position == position && n.forward() != forward);
        n.fly(DVec3::new(0.0, 0.0, 2.0));
        assert!(n.position.abs_diff_eq(position + 2.0 * n.forward(), 1e-9));
        assert!((n.distance - 4.0).abs() < 1e-9);
    }

    #[test]
    fn what_is_grabbed_follows_the_pointer() {
        let mut n = navigator();
        let grabbed = n.pivot();
        n.pan(DVec2::new(0.25, -0.1));
        let (at, _) = n.camera(600, 400).project(grabbed);
        assert!(at.abs_diff_eq(DVec2::new(300.0 + 100.0, 200.0 - 40.0), 1e-6), "{at}");
    }

    #[test]
    fn focus_turns_to_a_point() {
        let mut n = navigator();
        let point = DVec3::new(-3.0, 5.0, 9.0);
        n.focus(point);
        assert!(n.pivot().abs_diff_eq(point, 1e-9) && is_rotation(n.world_from_view));
        let before = n;
        n.focus(n.position);
        n.focus(DVec3::NAN);
        assert_eq!(n, before);
    }

    #[test]
    fn a_view_is_met_where_it_stands() {
        let camera = navigator().camera(320, 200);
        let n = Navigator::at(&camera, DVec3::new(1.0, 2.0, 3.0), DVec3::NEG_Y);
        let again = n.camera(320, 200);
        assert!(again.view_from_world.abs_diff_eq(camera.view_from_world, 1e-12));
        assert!(again.focal.abs_diff_eq(camera.focal, 1e-9) && again.center().abs_diff_eq(camera.center(), 1e-9));
        assert!((n.distance - 4.0).abs() < 1e-6);
        // Behind the camera there is nothing to go around.
        let away = Navigator::at(&camera, camera.center() - camera.forward(), DVec3::NEG_Y);
        assert!(away.distance > 0.5);
    }
}
