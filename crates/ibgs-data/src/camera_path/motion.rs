//! The way from one keyframe to the next: a cubic curve in position, rotation and zoom whose speed fits those of the
//! neighbouring ways.
//!
//! Each curve is a cubic Bezier curve written as a sum of three steps: the first with the speed at the start, the last
//! with the speed at the end, and in the middle what is missing. For rotations the sum is a product of three rotations
//! (Kim, Kim and Shin 1995). No step of them is longer than 300 degrees, so none can flip to its other way round.

use super::Keyframe;
use glam::{DMat3, DQuat, DVec3};

/// What leads from one keyframe to another.
#[derive(Clone, Copy)]
struct Step {
    shift: DVec3,
    /// Axis times angle, in view space, by the shorter way.
    turn: DVec3,
    /// Change of [`zoom`].
    zoom: f64,
}

impl Step {
    fn new(from: &Keyframe, to: &Keyframe) -> Self {
        let turn = orientation(from).inverse() * orientation(to);
        let turn = if turn.w < 0.0 { -turn } else { turn };
        Self { shift: to.position - from.position, turn: turn.to_scaled_axis(), zoom: zoom(to) - zoom(from) }
    }

    /// Speed at the keyframe between two steps that take these times: Catmull and Rom's, that of the straight way from the
    /// keyframe before to the one after. The zoom turns back at a keyframe or nowhere (Fritsch and Butland), so it never leaves
    /// the range of its keyframes.
    fn speed(self, next: Self, [own, its]: [f64; 2]) -> Self {
        let whole = own + its;
        let turning = self.zoom * next.zoom <= 0.0;
        let slopes = [(own + 2.0 * its) * own / self.zoom, (2.0 * own + its) * its / next.zoom];
        let zoom = if turning { 0.0 } else { 3.0 * whole / (slopes[0] + slopes[1]) };
        Self { shift: (self.shift + next.shift) / whole, turn: (self.turn + next.turn) / whole, zoom }
    }

    fn times(self, factor: f64) -> Self {
        Self { shift: self.shift * factor, turn: self.turn * factor, zoom: self.zoom * factor }
    }
}

fn orientation(key: &Keyframe) -> DQuat {
    DQuat::from_mat3(&key.world_from_view).normalize()
}

/// Grows evenly with the logarithm of sizes in the image.
fn zoom(key: &Keyframe) -> f64 {
    -(0.5 * key.fov).tan().ln()
}

/// The keyframe at `t` of the way, 0 at `from` and 1 at `to`, where the path comes from `before` and continues to
/// `after`; where it does not, it is at rest if it is eased. None without the two in the middle.
pub fn between([before, from, to, after]: [Option<&Keyframe>; 4], eased: bool, t: f64) -> Option<Keyframe> {
    let (from, to) = (from?, to?);
    let step = Step::new(from, to);
    let alone = step.times(if eased { 0.0 } else { 1.0 });
    let start = before.map_or(alone, |before| Step::new(before, from).speed(step, [from.way, to.way]).times(to.way));
    let end = after.map_or(alone, |after| step.speed(Step::new(to, after), [to.way, after.way]).times(to.way));
    // Sums of Bernstein polynomials: the share of each step that is done at `t`.
    let done = [1.0 - (1.0 - t).powi(3), t * t * (3.0 - 2.0 * t), t * t * t];

    let shifts = [start.shift / 3.0, step.shift - (start.shift + end.shift) / 3.0, end.shift / 3.0];
    let zooms = [start.zoom / 3.0, step.zoom - (start.zoom + end.zoom) / 3.0, end.zoom / 3.0];
    let turn = DQuat::from_scaled_axis;
    let missing = turn(-start.turn / 3.0) * turn(step.turn) * turn(-end.turn / 3.0);
    let turns = [start.turn / 3.0, missing.to_scaled_axis(), end.turn / 3.0];

    let [first, middle, last] = [0, 1, 2].map(|i| turn(turns[i] * done[i]));
    let orientation = (orientation(from) * first * middle * last).normalize();
    let shift: DVec3 = (0..3).map(|i| shifts[i] * done[i]).sum();
    let change: f64 = (0..3).map(|i| zooms[i] * done[i]).sum();
    Some(Keyframe {
        position: from.position + shift,
        world_from_view: DMat3::from_quat(orientation),
        fov: 2.0 * (-(zoom(from) + change)).exp().atan(),
        way: 1.0,
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::{difference, keyframe, path};
    use super::*;
    use crate::camera::Camera;
    use std::f64::consts::PI;

    /// Angle between the poses of two cameras in radians.
    fn angle(a: &Camera, b: &Camera) -> f64 {
        let turn = DQuat::from_mat3(&(a.view_from_world * b.view_from_world.transpose()));
        2.0 * DVec3::new(turn.x, turn.y, turn.z).length().atan2(turn.w.abs())
    }

    #[test]
    fn stays_a_smooth_rotation() {
        for cycle in [false, true] {
            let path = path(cycle);
            let at = |step: i32| path.camera_at(path.seconds * f64::from(step) / 10_000.0).unwrap();
            let mut speeds = Vec::new();
            for step in 0..10_000 {
                let (camera, next) = (at(step), at(step + 1));
                let turn = camera.view_from_world;
                assert!((turn * turn.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-12), "step {step}");
                assert!((turn.determinant() - 1.0).abs() < 1e-12, "step {step}");
                let (low, high) = (24.0 / 0.7f64.tan() - 1e-9, 24.0 / 0.2f64.tan() + 1e-9);
                assert!(camera.focal.x >= low && camera.focal.x <= high, "the zoom overshoots at step {step}");
                let zoom = (next.focal.x / camera.focal.x).ln();
                speeds.push((angle(&camera, &next), (next.center() - camera.center()).length(), zoom));
            }
            let wrapped = speeds.iter().zip(speeds.iter().cycle().skip(1)).take(if cycle { 10_000 } else { 9_999 });
            for (step, (a, b)) in wrapped.enumerate() {
                assert!(a.0 < 4e-3 && a.1 < 8e-3, "a jump at step {step}: {a:?}");
                let jerk = (a.0 - b.0).abs().max((a.1 - b.1).abs()).max((a.2 - b.2).abs());
                assert!(jerk < 2e-5, "a sudden turn at step {step}: {a:?} then {b:?}, cycle {cycle}");
            }
        }
    }

    #[test]
    fn the_way_back_is_the_same() {
        // About one axis; otherwise the order of the three rotations makes a small difference.
        let mut path = path(false);
        for (key, yaw) in path.keyframes.iter_mut().zip([0.0, 1.0, 1.2, -1.0, 1.9]) {
            key.world_from_view = DMat3::from_rotation_y(yaw);
        }
        let mut back = path.clone();
        back.keyframes.reverse();
        for step in 0..=100 {
            let time = 0.07 * f64::from(step);
            let (found, expected) = (back.camera_at(7.0 - time).unwrap(), path.camera_at(time).unwrap());
            assert!(difference(&found, &expected) < 1e-11, "step {step}");
        }
    }

    #[test]
    fn turns_the_short_way() {
        for turn in [1.7, 2.5, 3.1, -3.1] {
            let mut path = path(false);
            path.keyframes = [0.0, turn].map(|turn| keyframe([0.0; 3], [turn, 0.0, 0.0], 0.9)).to_vec();
            let half = path.camera_at(3.5).unwrap();
            assert!(difference(&half, &keyframe([0.0; 3], [turn / 2.0, 0.0, 0.0], 0.9).camera(64, 48)) < 1e-12);
        }
        // Steps of the same size about one axis go on evenly, past half a turn too.
        let mut path = path(true);
        path.keyframes = (0..3).map(|i| keyframe([0.0; 3], [f64::from(i) * PI / 1.5, 0.0, 0.0], 0.9)).collect();
        for step in 0..100 {
            let turn = f64::from(step) * 0.02 * PI;
            let found = path.camera_at(7.0 * f64::from(step) / 100.0).unwrap();
            assert!(difference(&found, &keyframe([0.0; 3], [turn, 0.0, 0.0], 0.9).camera(64, 48)) < 1e-12, "{step}");
        }
    }

    #[test]
    fn opposite_views_make_no_jump() {
        // Half turns about changing axes are the hardest case: both ways are equally long.
        let turns = [[0.0; 3], [PI, 0.0, 0.0], [PI, PI, 0.0], [0.0, PI, PI], [0.0, 0.0, PI]];
        let mut path = path(true);
        path.keyframes = turns.map(|turns| keyframe([0.0; 3], turns, 0.9)).to_vec();
        let at = |step: i32| path.camera_at(path.seconds * f64::from(step) / 10_000.0).unwrap();
        let largest = (0..10_000).map(|step| angle(&at(step), &at(step + 1))).fold(0.0, f64::max);
        assert!(largest < 5e-3, "{largest}");
    }
}
