//! Spherical harmonics with the constants and sign order of 3DGS (method.md section 2), degree 0 to 3.

use glam::DVec3;

const C0: f64 = 0.28209479177387814;
const C1: f64 = 0.4886025119029199;
const C2: [f64; 5] =
    [1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396];
const C3: [f64; 7] = [
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
];

/// The 16 basis functions at the unit direction `d`.
pub fn basis(d: DVec3) -> [f64; 16] {
    let DVec3 { x, y, z } = d;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        C0,
        -C1 * y,
        C1 * z,
        -C1 * x,
        C2[0] * x * y,
        C2[1] * y * z,
        C2[2] * (2.0 * zz - xx - yy),
        C2[3] * x * z,
        C2[4] * (xx - yy),
        C3[0] * y * (3.0 * xx - yy),
        C3[1] * x * y * z,
        C3[2] * y * (4.0 * zz - xx - yy),
        C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        C3[4] * x * (4.0 * zz - xx - yy),
        C3[5] * z * (xx - yy),
        C3[6] * x * (xx - 3.0 * yy),
    ]
}

/// Gradients of the 16 basis polynomials by the three components of `d`, taken as free variables.
pub fn basis_gradient(d: DVec3) -> [DVec3; 16] {
    let DVec3 { x, y, z } = d;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let v = DVec3::new;
    [
        DVec3::ZERO,
        v(0.0, -C1, 0.0),
        v(0.0, 0.0, C1),
        v(-C1, 0.0, 0.0),
        C2[0] * v(y, x, 0.0),
        C2[1] * v(0.0, z, y),
        C2[2] * v(-2.0 * x, -2.0 * y, 4.0 * z),
        C2[3] * v(z, 0.0, x),
        C2[4] * v(2.0 * x, -2.0 * y, 0.0),
        C3[0] * v(6.0 * x * y, 3.0 * xx - 3.0 * yy, 0.0),
        C3[1] * v(y * z, x * z, x * y),
        C3[2] * v(-2.0 * x * y, 4.0 * zz - xx - 3.0 * yy, 8.0 * y * z),
        C3[3] * v(-6.0 * x * z, -6.0 * y * z, 6.0 * zz - 3.0 * xx - 3.0 * yy),
        C3[4] * v(4.0 * zz - 3.0 * xx - yy, -2.0 * x * y, 8.0 * x * z),
        C3[5] * v(2.0 * x * z, -2.0 * y * z, xx - yy),
        C3[6] * v(3.0 * xx - 3.0 * yy, -6.0 * x * y, 0.0),
    ]
}

/// 0.5 + SH before the clamp. `sh` holds the coefficients of one Gaussian, coefficient-major then channel.
pub fn color(sh: &[f64], degree: usize, d: DVec3) -> [f64; 3] {
    let basis = basis(d);
    let mut out = [0.5; 3];
    for (b, coefficient) in basis.iter().zip(sh.chunks_exact(3)).take((degree + 1).pow(2)) {
        for (o, c) in out.iter_mut().zip(coefficient) {
            *o += b * c;
        }
    }
    out
}

/// Gradients of the clamped colour: by the coefficients (as many as `sh` holds, zero above `degree`) and by the unit
/// direction, whose normalisation is left to the caller. A channel clamped at 0 passes nothing.
pub fn color_backward(sh: &[f64], degree: usize, d: DVec3, v_color: [f64; 3]) -> (Vec<f64>, DVec3) {
    let unclamped = color(sh, degree, d);
    let v: [f64; 3] = std::array::from_fn(|c| if unclamped[c] > 0.0 { v_color[c] } else { 0.0 });
    let (values, gradients) = (basis(d), basis_gradient(d));
    let mut v_sh = vec![0.0; sh.len()];
    let mut v_direction = DVec3::ZERO;
    for k in 0..(degree + 1).pow(2) {
        for c in 0..3 {
            v_sh[3 * k + c] = values[k] * v[c];
            v_direction += gradients[k] * (v[c] * sh[3 * k + c]);
        }
    }
    (v_sh, v_direction)
}
