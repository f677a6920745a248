//! The camera as the scene file states it: a pinhole or fisheye with polynomial distortion.

use crate::camera::{Camera, MAX_COORDINATE};
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use std::f64::consts::PI;

/// What a lens does to the distance r = tan(theta) from the optical axis before the polynomial.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum Projection {
    /// r stays.
    #[default]
    Perspective,
    /// r becomes the angle theta itself (COLMAP's fisheye models, OpenCV's fisheye).
    Equidistant,
    /// r becomes atan(2 r tan(omega / 2)) / omega (COLMAP's FOV); omega = 0 is a pinhole.
    Fov(f64),
}

/// Distortion of normalised view coordinates `x = X/Z, y = Y/Z`. After the projection, with `r2 = x^2 + y^2`:
/// `x (1 + sum radial[i] r2^(i+1)) / (1 + sum rational[i] r2^(i+1)) + 2 p1 x y + p2 (r2 + 2 x^2) + s1 r2`, and the
/// same for y with p1 and p2 changing places and s2 (OpenCV's and COLMAP's convention).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Distortion {
    pub projection: Projection,
    pub radial: [f64; 4],
    pub rational: [f64; 3],
    pub tangential: [f64; 2],
    pub prism: [f64; 2],
}

/// Intrinsics with distortion, for photos of `width` x `height`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lens {
    pub width: u32,
    pub height: u32,
    pub focal: DVec2,
    pub principal: DVec2,
    pub distortion: Distortion,
}

/// Largest ratio between the size of an image and its focal length or principal point.
const MAX_TIMES: f64 = 1e6;

/// Degrees. At the same focal length and size an equidistant fisheye of 180 degrees becomes a pinhole of 115 degrees,
/// and a fisheye of 360 degrees a pinhole of 145.
const MAX_FISHEYE_VIEW: f64 = 150.0;

/// Rotation and translation, world to view, COLMAP axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    pub view_from_world: DMat3,
    pub translation: DVec3,
}

impl Projection {
    /// The factor of a coordinate at distance `r`.
    fn factor(self, r: f64) -> f64 {
        // Below, sine and angle agree to all digits.
        const SMALL: f64 = 1e-9;
        match self {
            Projection::Equidistant if r > SMALL => r.atan() / r,
            Projection::Fov(omega) if omega.abs() > SMALL => {
                let slope = 2.0 * (0.5 * omega).tan();
                if r > SMALL { (r * slope).atan() / (r * omega) } else { slope / omega }
            }
            _ => 1.0,
        }
    }
}

impl Distortion {
    pub(crate) fn is_none(&self) -> bool {
        *self == Distortion::default()
    }

    /// Radial factor at a squared radius.
    fn radial_factor(&self, r2: f64) -> f64 {
        let numerator = self.radial.iter().rev().fold(0.0, |sum, k| (sum + k) * r2);
        let denominator = self.rational.iter().rev().fold(0.0, |sum, k| (sum + k) * r2);
        (1.0 + numerator) / (1.0 + denominator)
    }

    /// Undistorted to distorted normalised coordinates.
    pub(crate) fn distort(&self, p: DVec2) -> DVec2 {
        let p = p * self.projection.factor(p.length());
        let r2 = p.length_squared();
        let ([p1, p2], [s1, s2]) = (self.tangential, self.prism);
        let xy = 2.0 * p.x * p.y;
        let x = p1 * xy + p2 * (r2 + 2.0 * p.x * p.x) + s1 * r2;
        let y = p2 * xy + p1 * (r2 + 2.0 * p.y * p.y) + s2 * r2;
        p * self.radial_factor(r2) + DVec2::new(x, y)
    }

    /// The way back from [`Distortion::distort`], by Newton's method; none where it finds none.
    pub(crate) fn undistort(&self, target: DVec2) -> Option<DVec2> {
        const ROUNDS: usize = 60;
        const STEP: f64 = 1e-6;
        let mut p = target;
        for _ in 0..ROUNDS {
            let miss = self.distort(p) - target;
            if miss.length() < 1e-13 {
                break;
            }
            let slope = |along: DVec2| (self.distort(p + along * STEP) - self.distort(p - along * STEP)) / (2.0 * STEP);
            p -= DMat2::from_cols(slope(DVec2::X), slope(DVec2::Y)).inverse() * miss;
        }
        (self.distort(p).distance(target) < 1e-9).then_some(p)
    }

    /// The largest radius up to `limit` below which the distorted radius still grows. Beyond it the polynomial
    /// folds back and would show parts of the photo a second time.
    pub(crate) fn fold_radius(&self, limit: f64) -> f64 {
        const STEPS: usize = 1024;
        let mut previous = 0.0;
        for step in 1..=STEPS {
            let radius = limit * step as f64 / STEPS as f64;
            let projected = radius * self.projection.factor(radius);
            let distorted = projected * self.radial_factor(projected * projected);
            // Also true for NaN and for a pole of the rational part, where the sign jumps.
            if distorted.partial_cmp(&previous) != Some(std::cmp::Ordering::Greater) {
                return limit * (step - 1) as f64 / STEPS as f64;
            }
            previous = distorted;
        }
        limit
    }

    /// Whether all coefficients are usable numbers.
    fn is_usable(&self) -> bool {
        let omega = if let Projection::Fov(omega) = self.projection { omega } else { 0.0 };
        let polynomial = self.radial.iter().chain(&self.rational);
        polynomial.chain(&self.tangential).chain(&self.prism).all(|k| k.is_finite()) && omega.abs() < PI
    }
}

impl Lens {
    /// What is wrong with the numbers, if anything.
    pub(crate) fn problem(&self) -> Option<String> {
        if self.width == 0 || self.height == 0 {
            Some(format!("the image size {} x {} is empty", self.width, self.height))
        } else if !self.focal.is_finite() || self.focal.min_element() <= 0.0 {
            Some(format!("the focal length {} is not a positive number", self.focal))
        } else if !self.principal.is_finite() {
            Some(format!("the principal point {} is not finite", self.principal))
        } else if let Some(problem) = self.misfit() {
            Some(problem)
        } else if !self.distortion.is_usable() {
            Some("a distortion coefficient is not finite (or omega of FOV not below pi)".to_owned())
        } else if self.is_fisheye() && self.field_of_view().max_element() > MAX_FISHEYE_VIEW {
            let DVec2 { x, y } = self.field_of_view();
            Some(format!(
                "the undistorted photo would show {x:.1} x {y:.1} degrees, more than {MAX_FISHEYE_VIEW}: the focal \
                 length {} is too short for a fisheye of {} x {} pixels",
                self.focal, self.width, self.height
            ))
        } else {
            None
        }
    }

    /// Says why the focal length or the principal point is impossible for an image of this size; none if both are
    /// possible.
    fn misfit(&self) -> Option<String> {
        let side = f64::from(self.width.max(self.height));
        let fits = (side / MAX_TIMES..=side * MAX_TIMES).contains(&self.focal.min_element())
            && self.focal.max_element() <= side * MAX_TIMES;
        let (width, height) = (self.width, self.height);
        if !fits {
            Some(format!("the focal length {} fits no image of {width} x {height} pixels", self.focal))
        } else if self.principal.abs().max_element() > side * MAX_TIMES {
            Some(format!("the principal point {} fits no image of {width} x {height} pixels", self.principal))
        } else {
            None
        }
    }

    /// Whether the lens bends more than a pinhole can show.
    pub(crate) fn is_fisheye(&self) -> bool {
        self.distortion.projection != Projection::Perspective
    }

    /// Degrees across that the pinhole of [`Lens::pinhole`] shows, horizontally and vertically.
    pub(crate) fn field_of_view(&self) -> DVec2 {
        let size = DVec2::new(f64::from(self.width), f64::from(self.height));
        let angle = |pixels: f64, focal: f64| (pixels / focal).atan().to_degrees();
        let (low, high) = (self.principal, size - self.principal);
        DVec2::new(
            angle(low.x, self.focal.x) + angle(high.x, self.focal.x),
            angle(low.y, self.focal.y) + angle(high.y, self.focal.y),
        )
    }

    /// The same lens for a photo resized to `width` x `height`.
    pub(crate) fn resized(&self, width: u32, height: u32) -> Lens {
        let scale = DVec2::new(f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height));
        Lens { width, height, focal: self.focal * scale, principal: self.principal * scale, ..*self }
    }

    /// The pinhole camera of the undistorted photo: focal length, principal point and size are kept.
    pub(crate) fn pinhole(&self, pose: &Pose) -> Camera {
        Camera {
            width: self.width,
            height: self.height,
            focal: self.focal,
            principal: self.principal,
            view_from_world: pose.view_from_world,
            translation: pose.translation,
        }
    }
}

fn check_center(center: DVec3) -> Result<(), String> {
    match center.abs().max_element() <= MAX_COORDINATE {
        true => Ok(()),
        false => Err(format!("the translation {center} lies beyond {MAX_COORDINATE:e}")),
    }
}

impl Pose {
    /// From COLMAP's quaternion `[w, x, y, z]` and translation, both world to view.
    pub(crate) fn from_colmap(q: [f64; 4], t: [f64; 3]) -> Result<Pose, String> {
        if !q.iter().chain(&t).all(|v| v.is_finite()) {
            return Err("the pose is not finite".to_owned());
        }
        check_center(DVec3::from_array(t))?;
        let [w, x, y, z] = q;
        let quaternion = DQuat::from_xyzw(x, y, z, w);
        // A tiny or huge norm would lose all digits on the way.
        if !(1e-6..1e6).contains(&quaternion.length()) {
            return Err(format!("the quaternion has norm {}", quaternion.length()));
        }
        Ok(Pose { view_from_world: DMat3::from_quat(quaternion.normalize()), translation: DVec3::from_array(t) })
    }

    /// From a camera-to-world matrix (rows) with OpenGL axes: x right, y up, z backward.
    pub(crate) fn from_opengl(rows: &[Vec<f64>]) -> Result<Pose, String> {
        let shape = matches!(rows.len(), 3 | 4) && rows.iter().all(|row| row.len() == 4);
        if !shape {
            return Err("the matrix is not 4 x 4 (or 3 x 4)".to_owned());
        }
        if rows.iter().flatten().any(|v| !v.is_finite()) {
            return Err("the matrix is not finite".to_owned());
        }
        let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
        let (x, y, z, center) = (column(0), column(1), column(2), column(3));
        check_center(center)?;
        // Files written with few digits are off by about 1e-4; anything far beyond is no rotation.
        let matrix = DMat3::from_cols(x, -y, -z);
        let error = matrix.transpose() * matrix - DMat3::IDENTITY;
        let worst = error.to_cols_array().iter().fold(0.0_f64, |m, e| m.max(e.abs()));
        if worst > 0.02 || matrix.determinant() <= 0.0 {
            return Err("the left 3 x 3 part is not a rotation".to_owned());
        }
        Ok(Pose::from_axes(matrix, center))
    }

    /// From a rotation from camera to world with OpenGL axes, and the camera's place.
    pub(crate) fn from_opengl_axes(rotation: DMat3, center: DVec3) -> Result<Pose, String> {
        check_center(center)?;
        let DMat3 { x_axis, y_axis, z_axis } = rotation;
        Ok(Pose::from_axes(DMat3::from_cols(x_axis, -y_axis, -z_axis), center))
    }

    /// From a rotation from world to view with COLMAP axes, to a few digits, and the translation behind it.
    pub(crate) fn from_view(rotation: DMat3, translation: DVec3) -> Result<Pose, String> {
        if !(rotation.is_finite() && translation.is_finite()) {
            return Err("the pose is not finite".to_owned());
        }
        check_center(rotation.transpose() * translation)?;
        let view_from_world = DMat3::from_quat(DQuat::from_mat3(&rotation).normalize());
        Ok(Pose { view_from_world, translation })
    }

    /// From a rotation from camera to world with COLMAP axes, to a few digits, and the camera's place.
    fn from_axes(matrix: DMat3, center: DVec3) -> Pose {
        let rotation = DMat3::from_quat(DQuat::from_mat3(&matrix).normalize());
        let view_from_world = rotation.transpose();
        Pose { view_from_world, translation: -(view_from_world * center) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lenses() -> Vec<Distortion> {
        let equidistant = Distortion { projection: Projection::Equidistant, ..Distortion::default() };
        vec![
            Distortion { radial: [-0.1, 0.03, 0.0, 0.0], tangential: [0.004, -0.003], ..Distortion::default() },
            Distortion { radial: [0.1, -0.05, 0.02, 0.0], rational: [0.15, -0.02, 0.01], ..Distortion::default() },
            equidistant,
            Distortion { radial: [0.05, -0.01, 0.003, -0.0004], ..equidistant },
            Distortion {
                radial: [0.03, -0.02, 0.001, -0.0002],
                tangential: [0.002, -0.001],
                prism: [0.0015, -0.0025],
                ..equidistant
            },
            Distortion { projection: Projection::Fov(0.9), ..Distortion::default() },
            Distortion { projection: Projection::Fov(-1.4), ..Distortion::default() },
        ]
    }

    #[test]
    fn distortion_and_its_inverse_cancel() {
        for lens in lenses() {
            for (i, j) in (-6..=6).flat_map(|i| (-6..=6).map(move |j| (i, j))) {
                let p = DVec2::new(f64::from(i), f64::from(j)) * 0.15;
                let there = lens.distort(p);
                assert!(lens.undistort(there).unwrap().distance(p) < 1e-9, "{lens:?} at {p}");
                assert!(lens.distort(lens.undistort(there).unwrap()).distance(there) < 1e-9, "{lens:?} at {p}");
            }
        }
    }

    #[test]
    fn projections_have_their_known_values() {
        let at = |projection, p: DVec2| Distortion { projection, ..Distortion::default() }.distort(p);
        let close = |a: DVec2, b: DVec2| assert!(a.distance(b) < 1e-12, "{a} {b}");
        close(at(Projection::Equidistant, DVec2::new(1.0, 0.0)), DVec2::new(PI / 4.0, 0.0));
        close(at(Projection::Equidistant, DVec2::new(0.0, -(3.0_f64.sqrt()))), DVec2::new(0.0, -PI / 3.0));
        close(at(Projection::Equidistant, DVec2::ZERO), DVec2::ZERO);
        // 2 tan(omega / 2) = 2 at a right angle: r = 1/2 becomes (pi/4) / (pi/2).
        close(at(Projection::Fov(PI / 2.0), DVec2::new(0.3, 0.4)), DVec2::new(0.3, 0.4));
        close(at(Projection::Fov(PI / 2.0), DVec2::new(0.5, 0.0)), DVec2::new(0.5, 0.0));
        close(at(Projection::Fov(PI / 2.0), DVec2::new(50.0, 0.0)), DVec2::new(100.0_f64.atan() / (PI / 2.0), 0.0));
        for projection in [Projection::Fov(0.0), Projection::Fov(1e-10)] {
            close(at(projection, DVec2::new(0.7, -0.2)), DVec2::new(0.7, -0.2));
        }
        // No step where the small radii begin.
        for projection in [Projection::Equidistant, Projection::Fov(1.2)] {
            let [below, above] = [0.999e-9, 1.001e-9].map(|r| projection.factor(r));
            assert!((below - above).abs() < 1e-12);
        }
    }

    #[test]
    fn a_fisheye_beyond_half_a_turn_stays_a_pinhole_of_bounded_view() {
        let lens = |focal: f64| Lens {
            width: 1000,
            height: 1000,
            focal: DVec2::splat(focal),
            principal: DVec2::splat(500.0),
            distortion: Distortion { projection: Projection::Equidistant, ..Distortion::default() },
        };
        let half_turn = lens(1000.0 / PI);
        assert!((half_turn.field_of_view().x - 115.04).abs() < 0.01, "{}", half_turn.field_of_view());
        assert_eq!((half_turn.problem(), lens(500.0 / PI).problem()), (None, None));
        assert!(lens(100.0).problem().unwrap().contains("degrees"));
    }
}
