//! The nodes of a glTF file: which mesh stands where, and Gaussians turned with their node.

use super::super::Gaussians;
use glam::{DMat3, DMat4, DQuat, DVec3};
use serde::Deserialize;
use std::f64::consts::PI;

/// Largest difference of a node's axes from equal lengths and right angles.
const TOLERANCE: f64 = 1e-4;

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct Node {
    pub(super) mesh: Option<usize>,
    children: Vec<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

impl Node {
    fn local(&self) -> DMat4 {
        match self.matrix {
            Some(matrix) => DMat4::from_cols_array(&matrix),
            None => DMat4::from_scale_rotation_translation(
                self.scale.map_or(DVec3::ONE, DVec3::from),
                self.rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_array(q).normalize()),
                self.translation.map_or(DVec3::ZERO, DVec3::from),
            ),
        }
    }
}

/// Every node below `roots` with a mesh: the mesh, and the world's matrix of the node.
///
/// # Errors
/// Where the nodes are no tree.
pub(super) fn meshes(nodes: &[Node], roots: &[usize]) -> Result<Vec<(usize, DMat4)>, String> {
    let mut found = Vec::new();
    let mut seen = vec![false; nodes.len()];
    let mut open: Vec<(usize, DMat4)> = roots.iter().rev().map(|&root| (root, DMat4::IDENTITY)).collect();
    while let Some((index, above)) = open.pop() {
        let node = nodes.get(index).ok_or_else(|| format!("it has no node {index}"))?;
        if std::mem::replace(&mut seen[index], true) {
            return Err(format!("its node {index} has two parents"));
        }
        let world = above * node.local();
        found.extend(node.mesh.map(|mesh| (mesh, world)));
        open.extend(node.children.iter().rev().map(|&child| (child, world)));
    }
    Ok(found)
}

/// A turn, a size and a place.
pub(super) struct Pose {
    turn: DMat3,
    scale: f64,
    place: DVec3,
}

impl Pose {
    /// Of a node's matrix.
    ///
    /// # Errors
    /// Where the matrix does anything else.
    pub(super) fn of(world: DMat4) -> Result<Self, String> {
        let axes = DMat3::from_mat4(world);
        let place = world.w_axis.truncate();
        let scale = axes.determinant().cbrt();
        let turn = axes * (1.0 / scale);
        let is_turn = scale > 0.0 && (turn.transpose() * turn).abs_diff_eq(DMat3::IDENTITY, TOLERANCE);
        match is_turn && place.is_finite() {
            true => Ok(Self { turn, scale, place }),
            false => Err("a node stretches or mirrors its Gaussians, which they cannot follow".to_owned()),
        }
    }

    /// Moves Gaussians with their node. Their coordinates are then around the node's place.
    pub(super) fn apply(&self, g: &mut Gaussians) {
        g.space.origin = self.place;
        if self.scale != 1.0 {
            let log = self.scale.ln() as f32;
            g.log_scales.as_flattened_mut().iter_mut().for_each(|v| *v += log);
        }
        for mean in &mut g.means {
            *mean = (self.turn * DVec3::from(mean.map(f64::from)) * self.scale).as_vec3().to_array();
        }
        if self.turn == DMat3::IDENTITY {
            return;
        }
        turn_each(g, self.turn);
    }
}

/// Turns each Gaussian about its centre: its axes and its colours, not its plane.
pub(in super::super) fn turn_each(g: &mut Gaussians, turn: DMat3) {
    let quaternion = DQuat::from_mat3(&turn).normalize();
    for q in &mut g.rotations {
        let [w, x, y, z] = q.map(f64::from);
        let turned = quaternion * DQuat::from_xyzw(x, y, z, w);
        *q = [turned.w, turned.x, turned.y, turned.z].map(|v| v as f32);
    }
    turn_harmonics(g, turn);
}

/// The spherical harmonics after a turn: each degree mixes its own coefficients, c'_i = sum over j of c_j times the integral of
/// Y_i(R d) Y_j(d) over all directions d.
fn turn_harmonics(g: &mut Gaussians, turn: DMat3) {
    let (count, degree) = (g.sh_coefficients(), g.sh_degree as usize);
    let mut mix = [[0.0; 16]; 16];
    for (d, weight) in directions() {
        let (before, after) = (basis(d), basis(turn * d));
        for (i, row) in mix.iter_mut().enumerate().take(count) {
            for j in (0..count).filter(|&j| j.isqrt() == i.isqrt()) {
                row[j] += weight * after[i] * before[j];
            }
        }
    }
    for row in g.sh.chunks_exact_mut(3 * count) {
        let old: Vec<f64> = row.iter().map(|&v| f64::from(v)).collect();
        for l in 1..=degree {
            for i in l * l..(l + 1) * (l + 1) {
                for channel in 0..3 {
                    let sum: f64 = (l * l..(l + 1) * (l + 1)).map(|j| mix[i][j] * old[3 * j + channel]).sum();
                    row[3 * i + channel] = sum as f32;
                }
            }
        }
    }
}

/// Directions and weights that integrate polynomials of degree 6 over the sphere exactly: four heights of Gauss and Legendre,
/// eight directions around each.
pub(super) fn directions() -> impl Iterator<Item = (DVec3, f64)> {
    let root = (6.0_f64 / 5.0).sqrt() * 2.0 / 7.0;
    let heights = [(3.0 / 7.0 - root, 18.0 + 30.0_f64.sqrt()), (3.0 / 7.0 + root, 18.0 - 30.0_f64.sqrt())];
    heights.into_iter().flat_map(|(square, weight)| {
        let (z, r) = (square.sqrt(), (1.0 - square).sqrt());
        [z, -z].into_iter().flat_map(move |z| {
            (0..8).map(move |step| {
                let (y, x) = (f64::from(step) * PI / 4.0).sin_cos();
                (DVec3::new(r * x, r * y, z), weight / 36.0 * PI / 4.0)
            })
        })
    })
}

/// The basis functions of degree 0 to 3, as 3DGS and the extension have them.
pub(in super::super) fn basis(d: DVec3) -> [f64; 16] {
    let DVec3 { x, y, z } = d;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let third = |k: f64| (k / PI).sqrt() / 4.0;
    [
        0.5 / PI.sqrt(),
        -(0.75 / PI).sqrt() * y,
        (0.75 / PI).sqrt() * z,
        -(0.75 / PI).sqrt() * x,
        0.5 * (15.0 / PI).sqrt() * x * y,
        -0.5 * (15.0 / PI).sqrt() * y * z,
        0.25 * (5.0 / PI).sqrt() * (2.0 * zz - xx - yy),
        -0.5 * (15.0 / PI).sqrt() * x * z,
        0.25 * (15.0 / PI).sqrt() * (xx - yy),
        -third(17.5) * y * (3.0 * xx - yy),
        2.0 * third(105.0) * x * y * z,
        -third(10.5) * y * (4.0 * zz - xx - yy),
        third(7.0) * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -third(10.5) * x * (4.0 * zz - xx - yy),
        third(105.0) * z * (xx - yy),
        -third(17.5) * x * (xx - 3.0 * yy),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Integrals of products of basis functions are those of an orthonormal basis, to the last digits of a double.
    #[test]
    fn basis_is_orthonormal() {
        for i in 0..16 {
            for j in 0..16 {
                let sum: f64 = directions().map(|(d, weight)| weight * basis(d)[i] * basis(d)[j]).sum();
                assert!((sum - f64::from(i == j)).abs() < 1e-12, "{i} {j}: {sum}");
            }
        }
        // A constant of degree 3 of 3DGS' code.
        assert!((basis(DVec3::X)[15] + 0.590_043_589_926_643_5).abs() < 1e-15);
    }

    /// Seen from a turned direction the turned Gaussian has the same colour.
    #[test]
    fn turned_colors_are_those_of_the_turned_direction() {
        let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.2, 2.5));
        let sh: Vec<f32> = (0..48).map(|i| ((i * 37 % 19) as f32 - 9.0) / 9.0).collect();
        let mut g = Gaussians { sh: sh.clone(), sh_degree: 3, ..Gaussians::default() };
        turn_harmonics(&mut g, turn);
        let color = |sh: &[f32], d: DVec3| -> f64 { (0..16).map(|i| basis(d)[i] * f64::from(sh[3 * i])).sum() };
        for (d, _) in directions() {
            // 16 coefficients of up to 1, rounded to floats.
            assert!((color(&sh, d) - color(&g.sh, turn * d)).abs() < 16.0 * f64::from(f32::EPSILON));
        }
    }

    #[test]
    fn nodes_that_no_gaussian_can_follow() {
        assert!(Pose::of(DMat4::from_scale(DVec3::new(1.0, 2.0, 1.0))).is_err());
        assert!(Pose::of(DMat4::from_scale(DVec3::new(1.0, -1.0, 1.0))).is_err());
        assert!(Pose::of(DMat4::ZERO).is_err());
        assert!(Pose::of(DMat4::from_scale(DVec3::splat(3.0))).is_ok());
    }
}
