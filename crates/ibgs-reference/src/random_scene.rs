//! Seeded random scenes whose numbers are all representable in f32, and scenes made to break a kernel.

use glam::{DMat3, DVec2, DVec3};
use ibgs_data::camera::Camera;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{NEAR, Params, Tensor};

/// The nearest value that f32 can hold.
pub fn exact(value: f64) -> f64 {
    f64::from(value as f32)
}

fn uniform<const N: usize>(rng: &mut ChaCha8Rng, low: f64, high: f64) -> [f64; N] {
    std::array::from_fn(|_| exact(rng.random_range(low..high)))
}

/// `n` Gaussians around the origin: some overlap, some are dark in one channel, quaternions are not normalised.
pub fn random_params(n: usize, sh_degree: usize, seed: u64) -> Params {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut p = Params { sh_degree, ..Params::default() };
    for _ in 0..n {
        p.means.push(uniform(&mut rng, -1.2, 1.2));
        p.rotations.push(loop {
            let q: [f64; 4] = uniform(&mut rng, -1.0, 1.0);
            if q.iter().map(|x| x * x).sum::<f64>() > 0.1 {
                break q;
            }
        });
        p.log_scales.push(uniform(&mut rng, -3.5, -1.2));
        p.opacity_logits.push(uniform::<1>(&mut rng, -2.0, 3.0)[0]);
        p.sh.extend(uniform::<3>(&mut rng, -1.8, 2.0));
        for _ in 1..(sh_degree + 1).pow(2) {
            p.sh.extend(uniform::<3>(&mut rng, -0.3, 0.3));
        }
    }
    p
}

/// A camera about 4 units from the origin that looks at it, with an off-centre principal point and fx != fy.
pub fn random_camera(width: u32, height: u32, seed: u64) -> Camera {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xca3e_7a00);
    let direction = loop {
        let d = DVec3::from_array(uniform(&mut rng, -1.0, 1.0));
        if (0.2..1.0).contains(&d.length()) {
            break d.normalize();
        }
    };
    let center = direction * rng.random_range(3.5..4.5);
    let target = DVec3::from_array(uniform(&mut rng, -0.2, 0.2));
    let forward = (target - center).normalize();
    let up_hint = DVec3::from_array(uniform(&mut rng, -1.0, 1.0)) + forward.any_orthogonal_vector();
    let right = forward.cross(up_hint).normalize();
    let down = forward.cross(right);
    let view_from_world = DMat3::from_cols(right, down, forward).transpose();
    let view_from_world = DMat3::from_cols_array(&view_from_world.to_cols_array().map(exact));
    let size = DVec2::new(f64::from(width), f64::from(height));
    let mut vary = |low: f64, high: f64| DVec2::from_array(uniform(&mut rng, low, high));
    let focal = size.x * vary(1.3, 1.7);
    let principal = size * vary(0.4, 0.6);
    Camera {
        width,
        height,
        focal: DVec2::from_array(focal.to_array().map(exact)),
        principal: DVec2::from_array(principal.to_array().map(exact)),
        view_from_world,
        translation: DVec3::from_array((-(view_from_world * center)).to_array().map(exact)),
    }
}

/// Ways to make a valid Gaussian difficult.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nasty {
    BehindCamera,
    AtCameraCenter,
    /// View depth 0.95 of the near plane, just culled.
    InsideNearPlane,
    /// View depth 1.05 of the near plane, just kept.
    BeyondNearPlane,
    /// Every scale exp(-30).
    ZeroScale,
    /// One scale exp(-30), one exp(0): a needle.
    Needle,
    /// Larger than the view.
    Huge,
    /// Logit 20.
    Opaque,
    /// Logit -20.
    Transparent,
    /// Far outside the field of view but large: the ratio x/z is held.
    OffScreen,
    /// All channels under zero.
    Dark,
    /// A quaternion a thousand times too long.
    LongRotation,
    /// A quaternion of zeros: has no direction, must vanish.
    ZeroRotation,
    /// A million units away.
    Remote,
}

impl Nasty {
    pub const ALL: [Nasty; 14] = [
        Nasty::BehindCamera,
        Nasty::AtCameraCenter,
        Nasty::InsideNearPlane,
        Nasty::BeyondNearPlane,
        Nasty::ZeroScale,
        Nasty::Needle,
        Nasty::Huge,
        Nasty::Opaque,
        Nasty::Transparent,
        Nasty::OffScreen,
        Nasty::Dark,
        Nasty::LongRotation,
        Nasty::ZeroRotation,
        Nasty::Remote,
    ];

    /// Changes Gaussian `i` as seen by `camera`.
    pub fn apply(self, p: &mut Params, i: usize, camera: &Camera) {
        let mut place = |x: f64, y: f64, z: f64| {
            let world = camera.center() + camera.view_from_world.transpose() * DVec3::new(x, y, z);
            p.means[i] = world.to_array().map(exact);
        };
        match self {
            Nasty::BehindCamera => place(0.0, 0.0, -2.0),
            Nasty::AtCameraCenter => place(0.0, 0.0, 0.0),
            Nasty::InsideNearPlane => place(0.0, 0.0, 0.95 * NEAR),
            Nasty::BeyondNearPlane => {
                place(0.05 * NEAR, 0.05 * NEAR, 1.05 * NEAR);
                p.log_scales[i] = [0.1, 0.05, 0.03].map(|s: f64| exact((s * NEAR).ln()));
            }
            Nasty::ZeroScale => p.log_scales[i] = [-30.0; 3],
            Nasty::Needle => p.log_scales[i] = [-30.0, 0.0, -30.0],
            Nasty::Huge => p.log_scales[i] = [2.0; 3],
            Nasty::Opaque => p.opacity_logits[i] = 20.0,
            Nasty::Transparent => p.opacity_logits[i] = -20.0,
            Nasty::OffScreen => {
                place(3.0, 0.1, 3.0);
                p.log_scales[i] = exact_all([1.0, 0.8, 0.9]);
            }
            Nasty::Dark => {
                let stride = 3 * p.sh_coefficients();
                p.sh[i * stride..i * stride + 3].fill(-10.0);
            }
            Nasty::LongRotation => p.rotations[i] = p.rotations[i].map(|q| exact(1000.0 * q)),
            Nasty::ZeroRotation => p.rotations[i] = [0.0; 4],
            Nasty::Remote => place(1e5, 0.0, 1e6),
        }
    }
}

fn exact_all(values: [f64; 3]) -> [f64; 3] {
    values.map(exact)
}

/// A random scene whose first Gaussians are the cases given, one each.
pub fn nasty_params(n: usize, sh_degree: usize, seed: u64, camera: &Camera, cases: &[Nasty]) -> Params {
    assert!(cases.len() <= n, "one Gaussian per case");
    let mut p = random_params(n, sh_degree, seed);
    for (i, case) in cases.iter().enumerate() {
        case.apply(&mut p, i, camera);
    }
    p
}

/// Values that no entry of a parameter should hold.
pub const POISON: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

/// Sets one entry (flat index) of one tensor.
pub fn poison(p: &mut Params, tensor: Tensor, entry: usize, value: f64) {
    p.get_mut(tensor)[entry] = value;
}

/// A random gradient by an image, entries in -1..1.
pub fn random_image(width: u32, height: u32, low: f64, high: f64, seed: u64) -> Vec<[f64; 3]> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x1a6e);
    (0..width * height).map(|_| uniform(&mut rng, low, high)).collect()
}
