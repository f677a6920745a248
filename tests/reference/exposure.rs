//! Twins of the exposure correction (method.md section 8).

use glam::{DMat3, DVec3};

/// corrected = linear base + offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    pub linear: DMat3,
    pub offset: DVec3,
}

impl Affine {
    pub const IDENTITY: Affine = Affine { linear: DMat3::IDENTITY, offset: DVec3::ZERO };

    pub fn apply(&self, color: [f64; 3]) -> [f64; 3] {
        (self.linear * DVec3::from(color) + self.offset).to_array()
    }

    /// Gradient by the colour from that by the corrected colour.
    pub fn backward(&self, v_corrected: [f64; 3]) -> [f64; 3] {
        (self.linear.transpose() * DVec3::from(v_corrected)).to_array()
    }

    /// Rows of [linear | offset].
    pub fn rows(&self) -> Vec<f64> {
        (0..3).flat_map(|r| self.linear.row(r).extend(self.offset[r]).to_array()).collect()
    }
}

/// Sum of a b^T.
fn outer(pairs: &[(DVec3, DVec3)]) -> DMat3 {
    pairs.iter().fold(DMat3::ZERO, |sum, (a, b)| sum + DMat3::from_cols(*a * b.x, *a * b.y, *a * b.z))
}

/// Pivots of the elimination of a symmetric matrix, without exchanges.
fn pivots(m: &DMat3) -> [f64; 3] {
    let (a, b) = (m.x_axis.x, m.x_axis.x * m.y_axis.y - m.x_axis.y * m.x_axis.y);
    [a, b / a, m.determinant() / b]
}

/// The affine map that takes `base` to `warped` over the visible pixels by least squares, with a ridge of 1e-6 mean
/// variances towards the identity. The identity for fewer than 64 pixels, a ratio of smallest to largest pivot under 1e-5,
/// or variances under 1e-8.
pub fn fit(base: &[[f64; 3]], warped: &[[f64; 3]], visible: &[bool]) -> Affine {
    let pairs: Vec<(DVec3, DVec3)> =
        (0..base.len()).filter(|i| visible[*i]).map(|i| (DVec3::from(base[i]), DVec3::from(warped[i]))).collect();
    let count = pairs.len() as f64;
    if count < 64.0 {
        return Affine::IDENTITY;
    }
    let mean_x = pairs.iter().map(|p| p.0).sum::<DVec3>() / count;
    let mean_y = pairs.iter().map(|p| p.1).sum::<DVec3>() / count;
    let centred: Vec<_> = pairs.iter().map(|(x, y)| (*x - mean_x, *y - mean_y)).collect();
    let own: Vec<_> = centred.iter().map(|(d, _)| (*d, *d)).collect();
    let swapped: Vec<_> = centred.iter().map(|(d, e)| (*e, *d)).collect();
    let (c, g) = (outer(&own), outer(&swapped));
    let ridge = 1e-6 * (c.x_axis.x + c.y_axis.y + c.z_axis.z) / 3.0;
    let system = c + DMat3::IDENTITY * ridge;
    let pivots = pivots(&system);
    let smallest = pivots.into_iter().fold(f64::INFINITY, f64::min);
    let largest = pivots.into_iter().fold(0.0, f64::max);
    if !(smallest >= 1e-5 * largest && largest >= 1e-8 * count) {
        return Affine::IDENTITY;
    }
    let linear = (g + DMat3::IDENTITY * ridge) * system.inverse();
    Affine { linear, offset: mean_y - linear * mean_x }
}
