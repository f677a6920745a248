//! Similarities between the frames of two reconstructions of the same cameras.

use crate::camera::Camera;
use crate::median;
use glam::{DMat3, DQuat, DVec3};

/// Rounds of weighing down the cameras that a fit does not explain.
const ROUNDS: usize = 4;

/// `x -> scale * rotation * x + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Positive.
    pub scale: f64,
    /// Proper rotation.
    pub rotation: DMat3,
    /// Units of the second frame.
    pub translation: DVec3,
}

/// Mean errors of cameras against the true ones, apart from a similarity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraErrors {
    /// Of the orientations, in degrees.
    pub degrees: f64,
    /// Of the places, in per cent of the distance to what the cameras show.
    pub distance: f64,
    /// Of the focal lengths, in per cent.
    pub focal: f64,
}

impl Similarity {
    /// Leaves everything where it is.
    pub const IDENTITY: Self = Self { scale: 1.0, rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// The one that takes the first camera of each pair to the second, as well as one can: rotations by their mean, scale and
    /// translation by least squares of the centres, both with less weight for pairs that stand out. Without pairs the identity;
    /// where all centres are one the scale is 1.
    pub fn fit(pairs: &[(Camera, Camera)]) -> Self {
        let mut weights = vec![1.0; pairs.len()];
        let mut best = Self::IDENTITY;
        for _ in 0..ROUNDS {
            best = Self::weighted(pairs, &weights);
            let moved: Vec<(f64, f64)> = pairs.iter().map(|(from, to)| best.residual(from, to)).collect();
            let middle = |of: fn(&(f64, f64)) -> f64| median(moved.iter().map(of).collect()).unwrap_or_default();
            let typical = (middle(|r| r.0), middle(|r| r.1));
            let part = |value: f64, typical: f64| if typical > 0.0 { (value / typical).powi(2) } else { 0.0 };
            for (weight, (angle, distance)) in weights.iter_mut().zip(&moved) {
                *weight = 1.0 / (1.0 + part(*angle, typical.0) + part(*distance, typical.1));
            }
        }
        best
    }

    /// Angle in radians and distance, in units of the second frame, by which the image of one camera misses the other.
    pub fn residual(&self, from: &Camera, to: &Camera) -> (f64, f64) {
        let moved = self.camera(from);
        let turn = DQuat::from_mat3(&(to.view_from_world * moved.view_from_world.transpose()));
        (2.0 * turn.w.abs().min(1.0).acos(), moved.center().distance(to.center()))
    }

    /// By how much the second camera of each pair misses the image of the first, the true one, on average. `distance` is that of the
    /// first to what it shows. Photos of the second may have another size.
    pub fn errors(&self, pairs: &[(Camera, Camera)], distance: impl Fn(&Camera) -> f64) -> CameraErrors {
        let count = pairs.len().max(1) as f64;
        pairs.iter().fold(CameraErrors::default(), |sum, (from, to)| {
            let (angle, miss) = self.residual(from, to);
            let lens = (to.focal / from.resized(to.width, to.height).focal - 1.0).abs().max_element();
            CameraErrors {
                degrees: sum.degrees + angle.to_degrees() / count,
                distance: sum.distance + 100.0 * miss / (self.scale * distance(from)) / count,
                focal: sum.focal + 100.0 * lens / count,
            }
        })
    }

    fn weighted(pairs: &[(Camera, Camera)], weights: &[f64]) -> Self {
        let all = || pairs.iter().zip(weights);
        let total: f64 = weights.iter().sum();
        if total <= 0.0 {
            return Self::IDENTITY;
        }
        let turn =
            |(from, to): &(Camera, Camera)| DQuat::from_mat3(&(to.view_from_world.transpose() * from.view_from_world));
        let first = turn(&pairs[0]);
        let sum = all().map(|(pair, weight)| {
            let turn = turn(pair);
            turn * (weight * turn.dot(first).signum())
        });
        let sum = sum.fold(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), |sum, turn| sum + turn);
        let rotation = DMat3::from_quat(if sum.length_squared() > 0.0 { sum.normalize() } else { first });
        let mean = |of: fn(&(Camera, Camera)) -> DVec3| all().map(|(p, w)| of(p) * *w).sum::<DVec3>() / total;
        let (from, to) = (mean(|p| p.0.center()), mean(|p| p.1.center()));
        let (mut product, mut square) = (0.0, 0.0);
        for ((a, b), weight) in all() {
            let offset = rotation * (a.center() - from);
            product += weight * (b.center() - to).dot(offset);
            square += weight * offset.length_squared();
        }
        let scale = if square > 0.0 && product > 0.0 { product / square } else { 1.0 };
        Self { scale, rotation, translation: to - scale * (rotation * from) }
    }

    /// A point of the first frame in the second.
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.scale * (self.rotation * point) + self.translation
    }

    /// This one, then another.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        Self {
            scale: next.scale * self.scale,
            rotation: next.rotation * self.rotation,
            translation: next.point(self.translation),
        }
    }

    /// The way back.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let (scale, rotation) = (self.scale.recip(), self.rotation.transpose());
        Self { scale, rotation, translation: -scale * (rotation * self.translation) }
    }

    /// A camera of the first frame in the second.
    pub fn camera(&self, camera: &Camera) -> Camera {
        let view_from_world = camera.view_from_world * self.rotation.transpose();
        let center = self.point(camera.center());
        Camera { view_from_world, translation: -(view_from_world * center), ..*camera }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_change::CameraChange;
    use glam::DVec2;

    fn cameras() -> Vec<Camera> {
        let camera = |i: u32| {
            let angle = f64::from(i) * 0.3;
            let view_from_world = DMat3::from_rotation_y(angle) * DMat3::from_rotation_x(0.2 * angle.sin());
            Camera {
                width: 40,
                height: 30,
                focal: DVec2::splat(30.0),
                principal: DVec2::new(20.0, 15.0),
                view_from_world,
                translation: DVec3::new(0.1 * angle, 0.3, 4.0 + 0.2 * angle.cos()),
            }
        };
        (0..21).map(camera).collect()
    }

    fn turned() -> Similarity {
        Similarity {
            scale: 1.7,
            rotation: DMat3::from_rotation_z(2.5) * DMat3::from_rotation_x(0.4),
            translation: DVec3::new(3.0, -1.0, 0.5),
        }
    }

    #[test]
    fn a_similarity_is_found_again_whatever_a_few_cameras_do() {
        let truth = turned();
        let astray = CameraChange::from_array([0.5, 0.0, 0.2, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let pair = |(i, camera): (usize, Camera)| {
            let there = truth.camera(&camera);
            (camera, if i % 7 == 3 { there.changed(&astray) } else { there })
        };
        let exact: Vec<_> = cameras().into_iter().map(|camera| (camera, truth.camera(&camera))).collect();
        let spoilt: Vec<_> = cameras().into_iter().enumerate().map(pair).collect();
        for (pairs, tolerance) in [(exact, 1e-12), (spoilt, 2e-2)] {
            let found = Similarity::fit(&pairs);
            assert!((found.scale - truth.scale).abs() < tolerance, "{found:?}");
            assert!(found.rotation.abs_diff_eq(truth.rotation, tolerance), "{found:?}");
            assert!(found.translation.abs_diff_eq(truth.translation, 5.0 * tolerance), "{found:?}");
        }
    }

    #[test]
    fn errors_of_cameras_are_apart_from_the_similarity() {
        let truth = turned();
        let pair = |(i, camera): (usize, Camera)| {
            let there = truth.camera(&camera).resized(80, 60);
            // Every second camera is turned about its centre by a degree, shifted by 0.17, and has a lens that is 2 % too long.
            let turn = CameraChange { rotation: DVec3::Y * 1_f64.to_radians(), ..CameraChange::default() };
            let turned = there.changed(&turn);
            let translation = -(turned.view_from_world * there.center()) + 0.17 * DVec3::Z;
            (camera, if i % 2 == 1 { Camera { translation, focal: 1.02 * there.focal, ..turned } } else { there })
        };
        let pairs: Vec<_> = cameras().into_iter().enumerate().map(pair).collect();
        // Ten of 21; 0.17 units there are 0.1 here, which is 5 % of two.
        let part = 10.0 / 21.0;
        let CameraErrors { degrees, distance, focal } = truth.errors(&pairs, |_| 2.0);
        assert!((degrees - part).abs() < 1e-6, "{degrees}");
        assert!((distance - 5.0 * part).abs() < 1e-9, "{distance}");
        assert!((focal - 2.0 * part).abs() < 1e-9, "{focal}");
        assert_eq!(truth.errors(&[], |_| 2.0), CameraErrors::default());
    }

    #[test]
    fn similarities_follow_each_other_and_are_undone() {
        let first = turned();
        let second = Similarity { scale: 0.3, rotation: DMat3::from_rotation_y(1.0), translation: DVec3::X };
        let point = DVec3::new(0.3, -2.0, 7.0);
        assert!(first.then(&second).point(point).abs_diff_eq(second.point(first.point(point)), 1e-12));
        assert!(first.inverse().point(first.point(point)).abs_diff_eq(point, 1e-12));
        assert!(first.point(first.inverse().point(point)).abs_diff_eq(point, 1e-12));
    }

    #[test]
    fn nothing_to_fit_is_no_change() {
        assert_eq!(Similarity::fit(&[]), Similarity::IDENTITY);
        let camera = cameras()[0];
        let same = Similarity::fit(&[(camera, camera)]);
        assert!((same.scale - 1.0).abs() < 1e-15 && same.rotation.abs_diff_eq(DMat3::IDENTITY, 1e-12));
        let moved = same.camera(&camera);
        assert!(moved.translation.abs_diff_eq(camera.translation, 1e-12));
    }
}
