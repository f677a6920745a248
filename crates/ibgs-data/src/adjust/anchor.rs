//! Cameras are held where they were given, as far as they prove to have been right: observations near each other hardly say how the
//! whole bends, and errors of single cameras do not bend it. How far single ones are off is what they move by against their neighbours.

use super::normal::Sums;
use super::reprojection::NUMBERS;
use crate::camera::{Camera, nearest};
use crate::median;
use glam::{DVec2, DVec3};

/// Expected error of focal lengths, in their logarithm.
const LENS: f64 = 0.01;
/// The loss of a camera's pose grows slower from as many expected squares on.
const FREEDOM: f64 = 6.0;
/// The median length of a vector of three normal numbers.
const MEDIAN: f64 = 1.54;
/// Cameras next to one that it is compared with.
const NEXT: usize = 2;
/// How much more the anchor of a pose counts than if observations were off by chance alone: errors that neighbours share mislead all.
const WEIGHT: f64 = 16.0;

/// Where the cameras were given, and how far they are expected to be off.
#[derive(Clone, Debug)]
pub(super) struct Anchor<'a> {
    given: &'a [Camera],
    /// Expected errors of each pose along an axis: radians, and length.
    expected: Vec<[f64; 2]>,
    /// The views' lenses by number, and the part of all views that has each.
    lens_of: &'a [usize],
    views_of: &'a [usize],
    /// What an expected square of a pose weighs in squared pixels, and of a lens for each of its views.
    weights: [f64; 2],
}

/// What cameras, at these depths, have moved by against those next to them, along an axis: radians, and parts of the depth.
pub(super) fn against_next(given: &[Camera], cameras: &[Camera], depths: &[f64]) -> [f64; 2] {
    let moved = given.iter().zip(cameras).zip(depths);
    let moved: Vec<[DVec3; 2]> = moved
        .map(|((from, to), depth)| {
            let [turn, shift] = to.movement_from(from);
            [turn, shift / *depth]
        })
        .collect();
    let next: Vec<Vec<usize>> = (0..given.len()).map(|view| nearest(given, view, NEXT)).collect();
    [0, 1].map(|i| {
        let against = next.iter().zip(&moved).filter(|(next, _)| !next.is_empty()).map(|(next, own)| {
            let count = next.len() as f64;
            let mean = next.iter().map(|view| moved[*view][i]).sum::<DVec3>() / count;
            (own[i] - mean).length() / (1.0 + count.recip()).sqrt()
        });
        median(against.collect()).unwrap_or(0.0) / MEDIAN
    })
}

impl<'a> Anchor<'a> {
    /// Expects errors as large as what the cameras, at these depths, have moved by against those next to them; `noise` is the typical
    /// error of an observation in pixels. None where they have not moved.
    pub fn new(
        given: &'a [Camera],
        (lens_of, views_of): (&'a [usize], &'a [usize]),
        (cameras, depths): (&[Camera], &[f64]),
        noise: f64,
    ) -> Option<Self> {
        let expected = against_next(given, cameras, depths);
        let weights = [WEIGHT * noise * noise, noise * noise];
        let each = depths.iter().map(|depth| [expected[0], expected[1] * depth]).collect();
        expected.iter().all(|e| *e > 0.0).then_some(Self { given, expected: each, lens_of, views_of, weights })
    }

    /// Turn and shift of a view in what is expected, and the length of both.
    fn off(&self, view: usize, camera: &Camera) -> ([DVec3; 2], f64) {
        let [turn, shift] = camera.movement_from(&self.given[view]);
        let [turn, shift] = [turn / self.expected[view][0], shift / self.expected[view][1]];
        ([turn, shift], turn.length_squared() + shift.length_squared())
    }

    /// What each lens is off by in what is expected, and what that weighs.
    fn lenses(&self, cameras: &[Camera]) -> Vec<(usize, DVec2, f64)> {
        let first = |lens: usize| self.lens_of.iter().position(|of| *of == lens);
        let lens = |(lens, views): (usize, &usize)| {
            let view = first(lens)?;
            let ratio = cameras[view].focal / self.given[view].focal;
            Some((view, ratio.map(f64::ln) / LENS, *views as f64 * self.weights[1]))
        };
        self.views_of.iter().enumerate().filter_map(lens).collect()
    }

    /// In squared pixels.
    pub fn cost(&self, cameras: &[Camera]) -> f64 {
        let pose = |(view, camera): (usize, &Camera)| FREEDOM * (self.off(view, camera).1 / FREEDOM).ln_1p();
        let poses: f64 = cameras.iter().enumerate().map(pose).sum();
        let lenses: f64 = self.lenses(cameras).iter().map(|(_, off, weight)| weight * off.length_squared()).sum();
        0.5 * (self.weights[0] * poses + lenses)
    }

    /// Adds its part to the equations of a step; `places` are those of a view's numbers.
    pub fn add(&self, cameras: &[Camera], places: impl Fn(usize) -> [usize; NUMBERS], sums: &mut Sums) {
        for (view, camera) in cameras.iter().enumerate() {
            let ([turn, shift], square) = self.off(view, camera);
            let weight = self.weights[0] / (1.0 + square / FREEDOM);
            let [turns, shifts] = self.expected[view];
            // A step of the translation moves the centre the other way.
            let right = [shift.x, shift.y, shift.z, -turn.x, -turn.y, -turn.z];
            for (i, (place, right)) in places(view).into_iter().zip(right).enumerate() {
                let expected = if i < 3 { shifts } else { turns };
                sums.add_own(place, weight / (expected * expected), weight * right / expected);
            }
        }
        for (view, off, weight) in self.lenses(cameras) {
            for (place, off) in places(view).into_iter().skip(6).zip(off.to_array()) {
                sums.add_own(place, weight / (LENS * LENS), -weight * off / LENS);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adjust::moved;
    use glam::DMat3;

    #[test]
    fn steps_go_down_the_cost_of_the_anchor() {
        let camera = |i: usize| Camera {
            width: 400,
            height: 300,
            focal: DVec2::new(300.0, 310.0),
            principal: DVec2::new(190.0, 140.0),
            view_from_world: DMat3::from_rotation_y(0.4 + i as f64),
            translation: DVec3::new(0.3, -0.7, 2.0),
        };
        let given = [camera(0), camera(1)];
        let off = |i: usize, by: f64| moved(&given[i], [by, -0.02, 0.01, 0.003, 0.002, -0.004, 0.01, -0.005]);
        let cameras = [off(0, 0.01), off(1, -0.03)];
        let anchor = Anchor::new(&given, (&[0, 0], &[2]), (&cameras, &[2.0, 3.0]), 0.5).unwrap();
        let places = |view: usize| std::array::from_fn(|i| if i < 6 { 6 * view + i } else { 6 + i });
        let mut sums = Sums::zero(14);
        anchor.add(&cameras, places, &mut sums);
        for (place, right) in sums.right().iter().enumerate() {
            let at = |by: f64| {
                let step = |view: usize| places(view).map(|own| if own == place { by } else { 0.0 });
                anchor.cost(&[moved(&cameras[0], step(0)), moved(&cameras[1], step(1))])
            };
            let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
            // Turns about different axes do not add up exactly.
            assert!((slope + right).abs() < 0.02 * slope.abs().max(1.0), "{place}: {slope} {right}");
        }
        assert!(anchor.cost(&given) < 1e-12 && anchor.cost(&cameras) > 1.0);
        assert!(Anchor::new(&given, (&[0, 0], &[2]), (&given, &[2.0, 3.0]), 0.5).is_none());
    }
}
