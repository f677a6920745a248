//! The camera as the scene file states it: a pinhole with polynomial distortion.

use crate::camera::Camera;
use glam::{DMat3, DQuat, DVec2, DVec3};

/// Radial and tangential distortion of normalised view coordinates `x = X/Z, y = Y/Z` with `r2 = x^2 + y^2`:
/// `x (1 + sum radial[i] r2^(i+1)) / (1 + sum rational[i] r2^(i+1)) + 2 p1 x y + p2 (r2 + 2 x^2)`, and the
/// same for y with p1 and p2 changing places (OpenCV's and COLMAP's convention).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Distortion {
    pub radial: [f64; 4],
    pub rational: [f64; 3],
    pub tangential: [f64; 2],
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

/// Rotation and translation, world to view, COLMAP axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    pub view_from_world: DMat3,
    pub translation: DVec3,
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
        let r2 = p.length_squared();
        let [p1, p2] = self.tangential;
        let xy = 2.0 * p.x * p.y;
        p * self.radial_factor(r2)
            + DVec2::new(p1 * xy + p2 * (r2 + 2.0 * p.x * p.x), p2 * xy + p1 * (r2 + 2.0 * p.y * p.y))
    }

    /// The largest radius up to `limit` below which the distorted radius still grows. Beyond it the polynomial
    /// folds back and would show parts of the photo a second time.
    pub(crate) fn fold_radius(&self, limit: f64) -> f64 {
        const STEPS: usize = 1024;
        let mut previous = 0.0;
        for step in 1..=STEPS {
            let radius = limit * step as f64 / STEPS as f64;
            let distorted = radius * self.radial_factor(radius * radius);
            // Also true for NaN and for a pole of the rational part, where the sign jumps.
            if distorted.partial_cmp(&previous) != Some(std::cmp::Ordering::Greater) {
                return limit * (step - 1) as f64 / STEPS as f64;
            }
            previous = distorted;
        }
        limit
    }
}

impl Lens {
    /// What is wrong with the numbers, if anything.
    pub(crate) fn problem(&self) -> Option<String> {
        let coefficients = self.distortion;
        let mut all = coefficients.radial.iter().chain(&coefficients.rational);
        if self.width == 0 || self.height == 0 {
            Some(format!("the image size {} x {} is empty", self.width, self.height))
        } else if !self.focal.is_finite() || self.focal.min_element() <= 0.0 {
            Some(format!("the focal length {} is not a positive number", self.focal))
        } else if !self.principal.is_finite() {
            Some(format!("the principal point {} is not finite", self.principal))
        } else if !all.all(|k| k.is_finite()) || coefficients.tangential.iter().any(|p| !p.is_finite()) {
            Some("a distortion coefficient is not finite".to_owned())
        } else {
            None
        }
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

impl Pose {
    /// From COLMAP's quaternion `[w, x, y, z]` and translation, both world to view.
    pub(crate) fn from_colmap(q: [f64; 4], t: [f64; 3]) -> Result<Pose, String> {
        if !q.iter().chain(&t).all(|v| v.is_finite()) {
            return Err("the pose is not finite".to_owned());
        }
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
        // Files written with few digits are off by about 1e-4; anything far beyond is no rotation.
        let matrix = DMat3::from_cols(x, -y, -z);
        let error = matrix.transpose() * matrix - DMat3::IDENTITY;
        let worst = error.to_cols_array().iter().fold(0.0_f64, |m, e| m.max(e.abs()));
        if worst > 0.02 || matrix.determinant() <= 0.0 {
            return Err("the left 3 x 3 part is not a rotation".to_owned());
        }
        let rotation = DMat3::from_quat(DQuat::from_mat3(&matrix).normalize());
        let view_from_world = rotation.transpose();
        Ok(Pose { view_from_world, translation: -(view_from_world * center) })
    }
}
