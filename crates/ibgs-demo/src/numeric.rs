//! Arithmetic that gives the same bits on every platform: only `+ - * /` and square roots, no libm.

use std::sync::LazyLock;

/// Sine and cosine of an angle in radians (Taylor series after reduction; error below 1e-14).
pub(super) fn sin_cos(angle: f64) -> (f64, f64) {
    use std::f64::consts::FRAC_PI_2;
    let quarter = floor(angle / FRAC_PI_2 + 0.5);
    let r = angle - quarter as f64 * FRAC_PI_2;
    let r2 = r * r;
    let (mut sin, mut cos) = (0.0, 0.0);
    for k in (0..9).rev() {
        let n = f64::from(2 * k);
        cos = 1.0 - cos * r2 / ((n + 1.0) * (n + 2.0));
        sin = 1.0 - sin * r2 / ((n + 2.0) * (n + 3.0));
    }
    sin *= r;
    match quarter.rem_euclid(4) {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Largest integer not above `x`.
pub(super) fn floor(x: f64) -> i64 {
    let i = x as i64;
    i - i64::from(x < i as f64)
}

/// Fraction of `x` in `[0, 1)`.
pub(super) fn fract(x: f64) -> f64 {
    x - floor(x) as f64
}

/// `x` to the power `2^squarings`.
pub(super) fn power_of_two(mut x: f64, squarings: u32) -> f64 {
    for _ in 0..squarings {
        x *= x;
    }
    x
}

/// Linear blend from `a` (weight 0) to `b` (weight 1).
pub(super) fn mix(a: glam::DVec3, b: glam::DVec3, weight: f64) -> glam::DVec3 {
    a + (b - a) * weight
}

/// Scrambles 64 bits; every input bit moves about half of the output bits.
pub(super) fn hash(mut x: u64) -> u64 {
    x = (x ^ (x >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    x = (x ^ (x >> 29)).wrapping_mul(0xa3ad_5e4b_79c1_3d4f);
    x ^ (x >> 32)
}

/// Hash of a lattice cell.
pub(super) fn hash_cell(x: i64, y: i64, salt: u64) -> u64 {
    let key = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f)
        ^ salt.wrapping_mul(0x1656_67b1_9e37_79f9);
    hash(key.wrapping_add(0x2545_f491_4f6c_dd1d))
}

/// The upper 53 bits as a number in `[0, 1)`.
pub(super) fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

/// Smooth value noise in `[0, 1)` on a unit lattice.
pub(super) fn noise(x: f64, y: f64, salt: u64) -> f64 {
    let (ix, iy) = (floor(x), floor(y));
    let (fx, fy) = (x - ix as f64, y - iy as f64);
    let (sx, sy) = (fx * fx * (3.0 - 2.0 * fx), fy * fy * (3.0 - 2.0 * fy));
    let at = |dx: i64, dy: i64| unit(hash_cell(ix + dx, iy + dy, salt));
    let low = at(0, 0) + (at(1, 0) - at(0, 0)) * sx;
    let high = at(0, 1) + (at(1, 1) - at(0, 1)) * sx;
    low + (high - low) * sy
}

/// A stream of random numbers; streams of different keys are independent.
pub(super) struct Stream {
    key: u64,
    counter: u64,
}

impl Stream {
    /// Stream number `index` of a seed and a purpose.
    pub fn new(seed: u64, purpose: u64, index: u64) -> Self {
        let key = hash(hash(hash(seed.wrapping_add(1)) ^ purpose) ^ index.wrapping_add(7));
        Stream { key, counter: 0 }
    }

    /// Next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.counter += 1;
        hash(self.key ^ self.counter.wrapping_mul(0x9e37_79b9_7f4a_7c15))
    }

    /// Next number in `[0, 1)`.
    pub fn uniform(&mut self) -> f64 {
        unit(self.bits())
    }

    /// Next whole number below `count` (which is at least 1).
    pub fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// Next number in `[-1, 1)`.
    pub fn signed(&mut self) -> f64 {
        2.0 * self.uniform() - 1.0
    }

    /// Next standard normal number (sum of 12 uniforms: no logarithm, never beyond 6).
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// 8-bit sRGB code of a linear value in `[0, 1]`, rounded to the nearest code.
pub(super) fn srgb_code(linear: f64) -> u8 {
    static THRESHOLDS: LazyLock<[f64; 255]> =
        LazyLock::new(|| std::array::from_fn(|code| linear_from_srgb((code as f64 + 0.5) / 255.0)));
    THRESHOLDS.partition_point(|&threshold| threshold <= linear) as u8
}

/// Linear value of an sRGB value, both in `[0, 1]`.
fn linear_from_srgb(value: f64) -> f64 {
    if value <= 0.04045 {
        return value / 12.92;
    }
    let base = (value + 0.055) / 1.055;
    // base^2.4 = base^2 * fifth root of base^2, the root by Newton's method from above.
    let square = base * base;
    let mut root = 1.0;
    for _ in 0..40 {
        let fourth = power_of_two(root, 2);
        root -= (root * fourth - square) / (5.0 * fourth);
    }
    square * root
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_agree_with_libm() {
        for k in -200..200 {
            let angle = f64::from(k) * 0.0731;
            let (sin, cos) = sin_cos(angle);
            assert!((sin - angle.sin()).abs() < 1e-13, "sin {angle}");
            assert!((cos - angle.cos()).abs() < 1e-13, "cos {angle}");
        }
    }

    #[test]
    fn srgb_codes_agree_with_the_standard() {
        for code in 0..=255u8 {
            let s = f64::from(code) / 255.0;
            let linear = if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) };
            assert_eq!(srgb_code(linear), code);
        }
        assert_eq!(srgb_code(-1.0), 0);
        assert_eq!(srgb_code(9.0), 255);
    }
}
