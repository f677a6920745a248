//! Ways to select Gaussians by shapes in the scene: a box, a ball.

use super::{Mask, place};
use crate::scene::Gaussians;
use glam::{DMat3, DVec3};

/// Number of a model's points to which a box around it is fitted.
const SAMPLES: usize = 20_000;
/// Least side of a box over its largest one.
const LEAST_SIDE: f64 = 1e-4;

/// A box in the scene that is turned about an up axis alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CropBox {
    /// Its middle.
    pub center: DVec3,
    /// Its sides: two across, then along the up axis.
    pub size: DVec3,
    /// The up axis, of length one.
    pub up: DVec3,
    /// Turn about it in radians.
    pub turn: f64,
}

impl CropBox {
    /// A box around `points` that leaves out the outermost fraction `outside` of them at each face; none without
    /// points.
    pub fn around(points: impl Iterator<Item = DVec3>, up: DVec3, turn: f64, outside: f64) -> Option<Self> {
        let blank = Self { center: DVec3::ZERO, size: DVec3::ZERO, up, turn };
        let axes = blank.axes();
        let points: Vec<DVec3> =
            points.map(|point| axes.transpose() * point).filter(|point| point.is_finite()).collect();
        let step = points.len().div_ceil(SAMPLES).max(1);
        let range = |axis: usize| {
            let mut values: Vec<f64> = points.iter().step_by(step).map(|point| point[axis]).collect();
            values.sort_unstable_by(f64::total_cmp);
            let last = values.len().checked_sub(1)?;
            let skipped = (outside.clamp(0.0, 0.5) * last as f64) as usize;
            Some((values[skipped], values[last - skipped]))
        };
        let [x, y, z] = [range(0)?, range(1)?, range(2)?];
        let (low, high) = (DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1));
        let size = high - low;
        let least = (LEAST_SIDE * size.max_element()).max(f64::MIN_POSITIVE);
        Some(Self { center: axes * (0.5 * (low + high)), size: size.max(DVec3::splat(least)), ..blank })
    }

    /// Its axes as columns: two across, then up.
    pub fn axes(&self) -> DMat3 {
        // A turn of 0 is along the world axis that is most perpendicular to the up axis.
        let least = self.up.abs().min_position();
        let across = DVec3::AXES[least];
        let first = (across - self.up * across.dot(self.up)).normalize_or(DVec3::X);
        let (sin, cos) = self.turn.sin_cos();
        let first = first * cos + self.up.cross(first) * sin;
        DMat3::from_cols(first, self.up.cross(first), self.up)
    }

    /// Whether a point lies in it.
    pub fn contains(&self, point: DVec3) -> bool {
        let inside = self.axes().transpose() * (point - self.center);
        inside.abs().cmple(0.5 * self.size).all()
    }

    /// Its corners; bit i of the number is set on the upper side of axis i.
    pub fn corners(&self) -> [DVec3; 8] {
        let axes = self.axes();
        std::array::from_fn(|corner| {
            let side = |axis: usize| if corner >> axis & 1 == 1 { 0.5 } else { -0.5 };
            self.center + axes * (self.size * DVec3::new(side(0), side(1), side(2)))
        })
    }

    /// Centre of a face, 0 to 5, and its outward direction.
    pub fn face(&self, face: usize) -> (DVec3, DVec3) {
        let (axis, sign) = (face / 2 % 3, if face.is_multiple_of(2) { -1.0 } else { 1.0 });
        let out = self.axes().col(axis) * sign;
        (self.center + out * (0.5 * self.size[axis]), out)
    }

    /// Moves a face outwards by a length; the opposite face stays where it is.
    pub fn move_face(&mut self, face: usize, by: f64) {
        let axis = face / 2 % 3;
        let (_, out) = self.face(face);
        let least = LEAST_SIDE * self.size.max_element();
        let by = by.max(least - self.size[axis]);
        self.size[axis] += by;
        self.center += out * (0.5 * by);
    }

    /// The Gaussians whose centres lie in it.
    pub fn found(&self, gaussians: &Gaussians) -> Mask {
        let (axes, half) = (self.axes().transpose(), 0.5 * self.size);
        Mask::of(gaussians.len(), |i| (axes * (place(gaussians, i) - self.center)).abs().cmple(half).all())
    }
}

/// The edges of the box, as pairs of indices into [`CropBox::corners`].
pub fn box_edges() -> impl Iterator<Item = [usize; 2]> {
    let edge = |corner: usize, axis: usize| (corner >> axis & 1 == 0).then_some([corner, corner | 1 << axis]);
    (0..8).flat_map(move |corner| (0..3).filter_map(move |axis| edge(corner, axis)))
}

/// A ball in the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Its middle.
    pub center: DVec3,
    /// Its radius in scene units.
    pub radius: f64,
}

impl Ball {
    /// The Gaussians whose centres lie in it.
    pub fn found(&self, gaussians: &Gaussians) -> Mask {
        Mask::of(gaussians.len(), |i| place(gaussians, i).distance(self.center) <= self.radius)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::grid;
    use super::*;

    #[test]
    fn a_box_finds_what_lies_in_it() {
        let gaussians = grid();
        let upright = CropBox { center: DVec3::ZERO, size: DVec3::new(2.2, 4.2, 0.2), up: DVec3::Z, turn: 0.0 };
        assert_eq!(upright.found(&gaussians).count(), 3 * 5);
        // A quarter turn changes the sides across.
        let turned = CropBox { turn: std::f64::consts::FRAC_PI_2, ..upright };
        let found = turned.found(&gaussians);
        assert_eq!(found.count(), 3 * 5);
        assert_eq!(found.and(&upright.found(&gaussians)).count(), 3 * 3);
        for up in [DVec3::NEG_Y, DVec3::X, DVec3::new(0.6, -0.8, 0.0)] {
            let tilted = CropBox { up, turn: 0.4, ..upright };
            let axes = tilted.axes();
            assert!((axes.transpose() * axes).abs_diff_eq(DMat3::IDENTITY, 1e-12) && axes.determinant() > 0.999);
            assert!(axes.z_axis.abs_diff_eq(up, 1e-12));
            let inside = |i: &usize| tilted.contains(place(&gaussians, *i));
            assert!(tilted.found(&gaussians).iter().eq((0..gaussians.len()).filter(inside)));
            assert!(tilted.corners().iter().all(|&c| tilted.contains(c.lerp(tilted.center, 1e-9))));
            assert!(tilted.corners().iter().all(|&c| !tilted.contains(c + (c - tilted.center) * 1e-9)));
        }
        assert_eq!(box_edges().count(), 12);
    }

    #[test]
    fn a_box_is_put_around_points_and_its_faces_move() {
        let gaussians = grid();
        let around = CropBox::around(gaussians.positions(), DVec3::NEG_Y, 0.3, 0.0).unwrap();
        let slack = CropBox { size: around.size * (1.0 + 1e-9), ..around };
        assert_eq!(slack.found(&gaussians).count(), gaussians.len());
        let inner = CropBox::around(gaussians.positions(), DVec3::NEG_Y, 0.0, 0.2).unwrap();
        assert!(inner.size.max_element() < 5.0 && inner.center.length() < 1e-6, "{inner:?}");
        assert_eq!(CropBox::around(std::iter::empty(), DVec3::Z, 0.0, 0.0), None);
        assert_eq!(CropBox::around([DVec3::NAN].into_iter(), DVec3::Z, 0.0, 0.0), None);
        let single = CropBox::around([DVec3::ONE].into_iter(), DVec3::Z, 0.0, 0.0).unwrap();
        assert!(single.size.min_element() > 0.0 && single.contains(DVec3::ONE));
        for face in 0..6 {
            let mut moved = around;
            let opposite = around.face(face ^ 1).0;
            moved.move_face(face, 1.5);
            assert!(moved.face(face).0.abs_diff_eq(around.face(face).0 + around.face(face).1 * 1.5, 1e-9));
            assert!(moved.face(face ^ 1).0.abs_diff_eq(opposite, 1e-9));
            moved.move_face(face, -1e9);
            assert!(moved.size.min_element() > 0.0 && moved.face(face ^ 1).0.abs_diff_eq(opposite, 1e-9));
        }
    }

    #[test]
    fn a_ball_finds_what_lies_in_it() {
        let gaussians = grid();
        let ball = |center: DVec3, radius: f64| Ball { center, radius }.found(&gaussians).count();
        assert_eq!(ball(DVec3::ZERO, 1.0), 7);
        assert_eq!(ball(DVec3::ZERO, 1.5), 19);
        assert_eq!(ball(DVec3::splat(3.0), 1.0), 4, "at a corner");
        assert_eq!(ball(DVec3::splat(0.5), 0.1), 0);
        assert_eq!(ball(DVec3::ZERO, 10.0), gaussians.len());
    }
}
