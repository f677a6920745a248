//! Photos that are compared, and what two of them have in common.

use super::features::{Descriptor, Features};
use crate::adjust::{Seen, Track, fitting};
use crate::camera::{Camera, nearest};
use glam::{DMat3, DVec2, DVec3};
use std::collections::BTreeSet;

/// Photos that a photo is compared with: those whose cameras are nearest.
const NEAREST: usize = 16;
/// Part of the longer side by which a place may lie off the line where the cameras expect it.
const OFF: f64 = 0.06;
/// Its difference is at most this part of that of the next best place.
const RATIO: f64 = 0.8;
/// Two photos have at least as many places in common, or none.
const FEWEST: usize = 15;

/// Pairs of views, each once.
pub(super) fn chosen(cameras: &[Camera]) -> Vec<[usize; 2]> {
    let of = |a: usize| nearest(cameras, a, NEAREST).into_iter().map(move |b| [a.min(b), a.max(b)]);
    let pairs: BTreeSet<[usize; 2]> = (0..cameras.len()).flat_map(of).collect();
    pairs.into_iter().collect()
}

/// Takes a pixel of one camera to the line of another on which it must lie: `n . pixel + c = 0`, n of length 1.
struct Epipolar {
    from: Camera,
    to: Camera,
    essential: DMat3,
}

impl Epipolar {
    fn new(from: &Camera, to: &Camera) -> Self {
        let (turn, t) = to.view_from(from);
        let cross =
            DMat3::from_cols(DVec3::new(0.0, t.z, -t.y), DVec3::new(-t.z, 0.0, t.x), DVec3::new(t.y, -t.x, 0.0));
        Self { from: *from, to: *to, essential: cross * turn }
    }

    fn line(&self, pixel: DVec2) -> Option<(DVec2, f64)> {
        let line = self.essential * ((pixel - self.from.principal) / self.from.focal).extend(1.0);
        let normal = line.truncate() / self.to.focal;
        let length = normal.length();
        let (normal, offset) = (normal / length, (line.z - normal.dot(self.to.principal)) / length);
        (normal.is_finite() && offset.is_finite()).then_some((normal, offset))
    }
}

fn difference(a: &Descriptor, b: &Descriptor) -> u32 {
    a.iter().zip(b).map(|(&a, &b)| u32::from(a.abs_diff(b)).pow(2)).sum()
}

/// The two best of what a descriptor was compared with: differences, and the place of the first.
#[derive(Clone, Copy)]
struct Best {
    first: u32,
    second: u32,
    place: usize,
}

impl Best {
    const NONE: Self = Self { first: u32::MAX, second: u32::MAX, place: usize::MAX };

    fn add(&mut self, difference: u32, place: usize) {
        if difference < self.first {
            let second = if place == self.place { self.second } else { self.first };
            *self = Self { first: difference, second, place };
        } else if difference < self.second && place != self.place {
            self.second = difference;
        }
    }

    fn is_clear(&self) -> bool {
        self.place != usize::MAX && f64::from(self.first) < RATIO * RATIO * f64::from(self.second)
    }
}

/// Places that look alike near where the cameras expect them, best of each other.
fn alike(cameras: [&Camera; 2], [a, b]: [&Features; 2]) -> Vec<[usize; 2]> {
    let epipolar = Epipolar::new(cameras[0], cameras[1]);
    let off = OFF * f64::from(cameras[1].width.max(cameras[1].height));
    let mut of_a = vec![Best::NONE; a.places.len()];
    let mut of_b = vec![Best::NONE; b.places.len()];
    for (place, descriptor) in &a.descriptors {
        let Some((normal, offset)) = epipolar.line(a.places[*place]) else { continue };
        for (other, compared) in &b.descriptors {
            if (normal.dot(b.places[*other]) + offset).abs() < off {
                let difference = difference(descriptor, compared);
                of_a[*place].add(difference, *other);
                of_b[*other].add(difference, *place);
            }
        }
    }
    let both = |(place, best): (usize, &Best)| {
        (best.is_clear() && of_b[best.place].place == place).then_some([place, best.place])
    };
    of_a.iter().enumerate().filter_map(both).collect()
}

/// Places that two photos have in common: which look alike and which the two cameras, adjusted to them, see at one point.
pub(super) fn matches(cameras: [&Camera; 2], features: [&Features; 2]) -> Vec<[usize; 2]> {
    let mut alike = alike(cameras, features);
    let track = |places: &[usize; 2]| Track {
        position: None,
        seen: (0..2).map(|view| Seen { view, pixel: features[view].places[places[view]] }).collect(),
    };
    let tracks: Vec<Track> = alike.iter().map(track).collect();
    let mut fits = fitting(&cameras.map(|camera| *camera), &tracks).into_iter();
    alike.retain(|_| fits.next() == Some(true));
    if alike.len() < FEWEST { Vec::new() } else { alike }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(i: usize) -> Camera {
        let turn = DMat3::from_rotation_y(0.3 * i as f64) * DMat3::from_rotation_x(0.1);
        Camera {
            width: 400,
            height: 300,
            focal: DVec2::new(300.0, 310.0),
            principal: DVec2::new(190.0, 140.0),
            view_from_world: turn,
            translation: DVec3::new(0.1 * i as f64, 0.0, 3.0),
        }
    }

    #[test]
    fn a_point_lies_on_the_line_of_its_pixel() {
        let [a, b] = [camera(0), camera(1)];
        let point = DVec3::new(0.4, -0.3, 0.2);
        let (from, to) = (a.project(point).0, b.project(point).0);
        let (normal, offset) = Epipolar::new(&a, &b).line(from).unwrap();
        assert!((normal.dot(to) + offset).abs() < 1e-9 && (normal.length() - 1.0).abs() < 1e-12);
        let other = b.project(a.unproject(from, 7.0)).0;
        assert!((normal.dot(other) + offset).abs() < 1e-9 && other.distance(to) > 1.0);
        assert!(Epipolar::new(&a, &a).line(from).is_none());
    }

    #[test]
    fn near_cameras_are_compared_each_pair_once() {
        let cameras: Vec<Camera> = (0..40).map(camera).collect();
        let pairs = chosen(&cameras);
        assert!(pairs.iter().all(|[a, b]| a < b) && pairs.contains(&[3, 4]) && !pairs.contains(&[0, 10]));
        assert!(pairs.len() >= 40 * NEAREST / 2 && pairs.len() <= 40 * NEAREST);
    }

    #[test]
    fn a_match_must_be_clear() {
        let mut best = Best::NONE;
        assert!(!best.is_clear());
        best.add(50, 3);
        // Another direction at the same place does not count against it.
        best.add(52, 3);
        best.add(100, 7);
        assert!(best.is_clear() && best.place == 3);
        best.add(60, 9);
        assert!(!best.is_clear());
        best.add(20, 9);
        assert!(best.is_clear() && best.place == 9);
    }
}
