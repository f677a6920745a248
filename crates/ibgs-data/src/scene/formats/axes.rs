//! Axes of other conventions: two of them point the other way, which is half a turn about the third.

use super::super::Gaussians;
use std::borrow::Cow;

/// Signs of the axes of 3DGS themselves (x right, y down, z forward).
pub(super) const RDF: [f32; 3] = [1.0; 3];

/// Signs from 3DGS' axes to those of OpenGL (x right, y up, z back), and back.
pub(super) const RUB: [f32; 3] = [1.0, -1.0, -1.0];

/// Signs from 3DGS' axes to those of glTF (x left, y up, z forward), and back.
pub(super) const LUF: [f32; 3] = [-1.0, -1.0, 1.0];

/// The same with changed axes. Applied twice it gives the same bits again.
pub(super) fn turned(gaussians: Cow<'_, Gaussians>, signs: [f32; 3]) -> Cow<'_, Gaussians> {
    if signs == RDF {
        return gaussians;
    }
    let mut turned = gaussians.into_owned();
    turn(&mut turned, signs);
    Cow::Owned(turned)
}

/// Multiplies the axes with `signs`, an even number of them negative. Quaternions become those of S R S, which differs from
/// S R only in the directions of the Gaussian's own axes.
pub(super) fn turn(gaussians: &mut Gaussians, signs: [f32; 3]) {
    if signs == RDF {
        return;
    }
    let [x, y, z] = signs;
    let vector = |v: &mut [f32; 3]| *v = [x * v[0], y * v[1], z * v[2]];
    // Adding 0 turns -0 into +0.
    gaussians.space.origin = gaussians.space.origin * glam::DVec3::from(signs.map(f64::from)) + glam::DVec3::ZERO;
    gaussians.means.iter_mut().for_each(vector);
    gaussians.normals.iter_mut().for_each(vector);
    for q in &mut gaussians.rotations {
        *q = [q[0], y * z * q[1], x * z * q[2], x * y * q[3]];
    }
    let (signs, row) = (sh_signs(signs), 3 * gaussians.sh_coefficients());
    for row in gaussians.sh.chunks_exact_mut(row) {
        for (rgb, sign) in row.chunks_exact_mut(3).zip(signs) {
            rgb.iter_mut().for_each(|value| *value *= sign);
        }
    }
}

/// The sign of each basis function of degree 0 to 3 in axes that are multiplied with these signs: that of its monomial.
fn sh_signs([x, y, z]: [f32; 3]) -> [f32; 16] {
    [1.0, y, z, x, x * y, y * z, 1.0, x * z, 1.0, y, x * y * z, y, z, x, z, x]
}
