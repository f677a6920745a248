//! A turn around what a capture shows: once around, or to and fro where the photos stand on one side.

use super::Keyframe;
use crate::camera::Camera;
use crate::median;
use glam::{DMat3, DVec3};
use std::f64::consts::{PI, TAU};

/// Keyframes of a turn. The smooth way through so many stays within a thousandth of the radius of the circle.
const KEYFRAMES: u32 = 16;
/// A turn leaves out a part of the circle without photos that is at least this wide, in radians.
const UNSEEN: f64 = TAU / 4.0;
/// Least angle to either side of a turn to and fro, in radians.
const LEAST_SWING: f64 = TAU / 24.0;

/// A turn goes about this axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// What is looked at.
    pub center: DVec3,
    /// Up, of length one.
    pub up: DVec3,
}

impl Axis {
    /// The axis of a capture around something; none where its cameras look at no common point.
    pub fn of<'a>(cameras: impl Iterator<Item = &'a Camera> + Clone) -> Option<Self> {
        Some(Self { center: looked_at(cameras.clone())?, up: up_axis(cameras) })
    }

    /// Where a turn amid these cameras starts: on the side of the first one, at their median height and distance from the axis,
    /// with the first one's field of view. None without a camera, or where they are above or under the centre.
    pub fn start<'a>(&self, cameras: impl Iterator<Item = &'a Camera> + Clone) -> Option<Keyframe> {
        let offset = |camera: &Camera| camera.center() - self.center;
        let height = |camera: &Camera| offset(camera).dot(self.up);
        let aside = |camera: &Camera| offset(camera) - self.up * height(camera);
        let first = cameras.clone().next()?;
        let side = aside(first).try_normalize()?;
        let height = median(cameras.clone().map(height).collect())?;
        let distance = median(cameras.map(|camera| aside(camera).length()).collect())?;
        let from_center = side * distance + self.up * height;
        Some(Keyframe {
            position: self.center + from_center,
            world_from_view: facing((-from_center).try_normalize()?, self.up)?,
            fov: first.vertical_fov(),
            way: 1.0,
        })
    }

    /// The keyframes of a turn that starts and ends at `start`, for a film that can be repeated: once around, counterclockwise seen
    /// from above. Where the photos' cameras leave a quarter of the circle or more empty, the turn goes to and fro in the rest of it,
    /// and starts at its nearest end where `start` lies outside.
    pub fn turn<'a>(&self, start: &Keyframe, cameras: impl Iterator<Item = &'a Camera>) -> Vec<Keyframe> {
        let swing = self.swing(start, cameras);
        let key = |i: u32| {
            let phase = TAU * f64::from(i) / f64::from(KEYFRAMES);
            let angle = match swing {
                None => phase,
                Some((middle, half)) => middle + half * (phase + (-middle / half).clamp(-1.0, 1.0).asin()).sin(),
            };
            let turn = DMat3::from_axis_angle(self.up, angle);
            let position = self.center + turn * (start.position - self.center);
            Keyframe { position, world_from_view: turn * start.world_from_view, ..*start }
        };
        (0..KEYFRAMES).map(key).collect()
    }

    /// Middle and half width of the part of the circle on which the cameras stand, as angles from `start`; none where they stand all
    /// around, or nowhere.
    fn swing<'a>(&self, start: &Keyframe, cameras: impl Iterator<Item = &'a Camera>) -> Option<(f64, f64)> {
        let ahead = start.position - self.center;
        let angle = |camera: &Camera| {
            let offset = camera.center() - self.center;
            self.up.dot(ahead.cross(offset)).atan2(ahead.reject_from(self.up).dot(offset))
        };
        let mut angles: Vec<f64> = cameras.map(angle).collect();
        angles.sort_by(f64::total_cmp);
        let next = angles.iter().skip(1).copied().chain(angles.first().map(|first| first + TAU));
        let gaps = angles.iter().zip(next).map(|(&angle, next)| (next - angle, next));
        let (gap, first) = gaps.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let width = TAU - gap;
        // Between -PI and PI, so that the turn starts at `start` where it can.
        let middle = (first + width / 2.0 + PI).rem_euclid(TAU) - PI;
        (gap >= UNSEEN).then_some((middle, (width / 2.0).max(LEAST_SWING)))
    }
}

/// Axes of an upright view in this direction, of length one; none straight up or down.
fn facing(forward: DVec3, up: DVec3) -> Option<DMat3> {
    let right = forward.cross(up).try_normalize()?;
    Some(DMat3::from_cols(right, forward.cross(right), forward))
}

/// The up axis of a capture: photos are upright on average.
pub fn up_axis<'a>(cameras: impl Iterator<Item = &'a Camera>) -> DVec3 {
    let sum: DVec3 = cameras.map(|camera| camera.view_from_world.transpose() * DVec3::NEG_Y).sum();
    sum.try_normalize().unwrap_or(DVec3::NEG_Y)
}

/// The point nearest to all optical axes: what a capture looks at. None where they are nearly parallel.
pub fn looked_at<'a>(cameras: impl Iterator<Item = &'a Camera> + Clone) -> Option<DVec3> {
    // Sum of (I - f f^T) (p - c) = 0 over the cameras.
    let mut matrix = DMat3::ZERO;
    let mut right = DVec3::ZERO;
    for camera in cameras.clone() {
        let f = camera.forward();
        let across = DMat3::IDENTITY - DMat3::from_cols(f * f.x, f * f.y, f * f.z);
        matrix += across;
        right += across * camera.center();
    }
    let count = cameras.clone().count() as f64;
    // Nearly parallel axes meet nowhere.
    if count < 2.0 || matrix.determinant() < 1e-3 * count.powi(3) {
        return None;
    }
    let point = matrix.inverse() * right;
    let ahead = cameras.filter(|camera| camera.to_view(point).z > 0.0).count() as f64;
    (point.is_finite() && ahead > 0.5 * count).then_some(point)
}

#[cfg(test)]
mod tests {
    use super::super::KeyframePath;
    use super::*;

    /// Cameras on a ring with this height and radius around `center`, y down, looking at it.
    fn ring(center: DVec3, height: f64, radius: f64) -> Vec<Camera> {
        let axis = Axis { center, up: DVec3::NEG_Y };
        let position = center + DVec3::new(0.0, -height, -radius);
        let world_from_view = facing((center - position).normalize(), axis.up).unwrap();
        let first = Keyframe { position, world_from_view, fov: 0.8, way: 1.0 };
        axis.turn(&first, [].iter()).iter().map(|key| key.camera(64, 48)).collect()
    }

    #[test]
    fn a_ring_of_cameras_looks_at_its_middle() {
        let target = DVec3::new(1.0, -2.0, 0.5);
        let cameras = ring(target, 0.9, 3.0);
        assert!(looked_at(cameras.iter()).unwrap().abs_diff_eq(target, 1e-9));
        assert!(up_axis(cameras.iter()).abs_diff_eq(DVec3::NEG_Y, 1e-9));
        assert!(up_axis(cameras[..1].iter()).dot(-cameras[0].view_from_world.row(1)) > 0.999);
        assert_eq!(up_axis([].iter()), DVec3::NEG_Y);
        // Cameras that face forward side by side meet nowhere; neither does one alone.
        let row = (0..4).map(|i| {
            let position = DVec3::new(f64::from(i), 0.0, 0.0);
            Keyframe { position, world_from_view: DMat3::IDENTITY, fov: 0.8, way: 1.0 }.camera(64, 48)
        });
        let row: Vec<Camera> = row.collect();
        assert_eq!(looked_at(row.iter()), None);
        assert_eq!(Axis::of(row.iter()), None);
        assert_eq!(looked_at(cameras[..1].iter()), None);
        assert_eq!(Axis::of([].iter()), None);
    }

    #[test]
    fn a_turn_stays_on_its_circle_and_looks_at_the_middle() {
        let target = DVec3::new(4e3, -7e3, 5.0);
        let cameras = [ring(target, 1.0, 3.0), ring(target, 1.0, 3.0), ring(target, 9.0, 5.0)].concat();
        let axis = Axis::of(cameras.iter()).unwrap();
        let start = axis.start(cameras.iter()).unwrap();
        assert!((start.fov - 0.8).abs() < 1e-9);
        let keyframes = axis.turn(&start, cameras.iter());
        let path =
            KeyframePath { keyframes, width: 64, height: 48, fps: 30.0, seconds: 10.0, cycle: true, eased: false };
        let frames = path.frames();
        assert_eq!(frames.len(), 300);
        for camera in &frames {
            let offset = camera.center() - axis.center;
            let height = offset.dot(axis.up);
            let radius = (offset - axis.up * height).length();
            assert!((height - 1.0).abs() < 2e-3 && (radius - 3.0).abs() < 3e-3, "height {height}, radius {radius}");
            let seen = camera.to_view(axis.center);
            assert!(seen.z > 0.0 && seen.truncate().length() < 2e-3 * seen.z, "the middle is at {seen}");
        }
        let step = |a: &Camera, b: &Camera| a.center().distance(b.center());
        let steps: Vec<f64> = frames.windows(2).map(|pair| step(&pair[0], &pair[1])).collect();
        let (least, most) = steps.iter().fold((f64::MAX, 0f64), |(l, m), &s| (l.min(s), m.max(s)));
        assert!(most / least < 1.04, "the speed changes by {}", most / least);
        let closing = step(&frames[299], &frames[0]);
        assert!((0.99 * least..1.01 * most).contains(&closing), "the last frame is {closing} from the first");
    }

    #[test]
    fn where_photos_stand_on_one_side_the_turn_goes_to_and_fro() {
        let target = DVec3::new(1.0, 2.0, 3.0);
        let all = ring(target, 1.0, 3.0);
        let axis = Axis::of(all.iter()).unwrap();
        // Five neighbours of 16, across the place where angles wrap around; the path starts at the first of them.
        for begin in 0..all.len() {
            let some: Vec<Camera> = all.iter().cycle().skip(begin).take(5).copied().collect();
            let start = axis.start(some.iter()).unwrap();
            let keyframes = axis.turn(&start, some.iter());
            assert!(keyframes[0].position.abs_diff_eq(some[0].center(), 1e-6), "begin {begin}");
            let nearest = |key: &Keyframe| {
                let distances = some.iter().map(|camera| camera.center().distance(key.position));
                distances.fold(f64::MAX, f64::min)
            };
            let farthest = keyframes.iter().map(nearest).fold(0.0, f64::max);
            assert!(farthest < 0.6, "begin {begin}: {farthest} from any photo, which stand 1.17 apart");
            let reaches = |camera: &Camera| keyframes.iter().any(|key| key.position.distance(camera.center()) < 0.6);
            assert!(some.iter().all(reaches), "begin {begin}");
            // It looks at the middle all the way.
            assert!(keyframes.iter().all(|key| key.camera(64, 48).to_view(target).truncate().length() < 1e-6));
            // From the far side it starts at an end.
            let far = Keyframe {
                position: all[(begin + 10) % 16].center(),
                world_from_view: all[(begin + 10) % 16].view_from_world.transpose(),
                fov: 0.8,
                way: 1.0,
            };
            let ends = [some[0].center(), some[4].center()];
            let first = axis.turn(&far, some.iter())[0].position;
            assert!(ends.iter().any(|end| end.abs_diff_eq(first, 1e-6)), "begin {begin}");
        }
        // A gap under a quarter is no side.
        let most: Vec<Camera> = all[..14].to_vec();
        let start = axis.start(most.iter()).unwrap();
        assert_eq!(axis.turn(&start, most.iter()), axis.turn(&start, [].iter()));
    }

    #[test]
    fn cameras_above_the_middle_have_no_side_to_start_from() {
        let axis = Axis { center: DVec3::ZERO, up: DVec3::NEG_Y };
        let down = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
        let above =
            Keyframe { position: DVec3::new(0.0, -2.0, 0.0), world_from_view: down, fov: 0.8, way: 1.0 }.camera(64, 48);
        assert_eq!(axis.start([above].iter()), None);
        assert_eq!(axis.start([].iter()), None);
    }
}
