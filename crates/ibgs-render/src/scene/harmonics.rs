//! How the device keeps spherical-harmonics coefficients.

use super::PerGaussian;
use bytemuck::{cast_slice, pod_collect_to_vec};
use half::f16;
use std::borrow::Cow;

/// How precisely the device keeps spherical-harmonics coefficients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Harmonics {
    /// float32, `[N, K, 3]`.
    #[default]
    Full,
    /// Halves, for frames without gradients: coefficients by twos, in three words of two halves each, `[N, ceil(K / 2), 3, 2]`.
    /// Values of up to 65,504 keep 11 binary digits; larger ones become that.
    Half,
}

impl Harmonics {
    /// 4-byte words of a Gaussian's colours.
    fn words(self, coefficients: usize) -> usize {
        match self {
            Self::Full => 3 * coefficients,
            Self::Half => 3 * coefficients.div_ceil(2),
        }
    }

    /// 4-byte words of a Gaussian with `coefficients` colours.
    pub fn rows(self, coefficients: usize) -> PerGaussian<usize> {
        PerGaussian { sh: self.words(coefficients), ..PerGaussian::rows(coefficients) }
    }

    /// The words of Gaussians with `coefficients` colours each.
    pub(crate) fn pack(self, values: PerGaussian<&[f32]>, coefficients: usize) -> PerGaussian<Cow<'_, [u32]>> {
        PerGaussian { sh: self.pack_sh(values.sh, coefficients), ..values.map(|v| Cow::Borrowed(cast_slice(v))) }
    }

    /// The words of colours `[N, coefficients, 3]`.
    fn pack_sh(self, sh: &[f32], coefficients: usize) -> Cow<'_, [u32]> {
        match self {
            Self::Full => Cow::Borrowed(cast_slice(sh)),
            Self::Half => {
                let mut halves = Vec::with_capacity(2 * self.words(coefficients) * sh.len() / (3 * coefficients));
                for gaussian in sh.chunks_exact(3 * coefficients) {
                    halves.extend(gaussian.iter().map(|&v| f16::from_f32(within(v))));
                    halves.resize(halves.len().next_multiple_of(6), f16::ZERO);
                }
                Cow::Owned(pod_collect_to_vec(&halves))
            }
        }
    }

    /// The colours of such words, `[N, coefficients, 3]`.
    pub(crate) fn unpack_sh(self, words: &[u32], coefficients: usize) -> Vec<f32> {
        match self {
            Self::Full => pod_collect_to_vec(words),
            Self::Half => {
                let gaussians = cast_slice::<_, f16>(words).chunks_exact(2 * self.words(coefficients));
                gaussians.flat_map(|halves| &halves[..3 * coefficients]).map(|half| half.to_f32()).collect()
            }
        }
    }
}

/// The nearest number that a half has; what is not finite stays as it is.
fn within(v: f32) -> f32 {
    let most = f16::MAX.to_f32();
    if v.is_finite() { v.clamp(-most, most) } else { v }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_come_back_as_the_nearest_ones() {
        for coefficients in [1, 4, 9, 16] {
            let sh: Vec<f32> = (0..2 * 3 * coefficients).map(|i| 0.01 * i as f32 - 0.3).collect();
            let words = Harmonics::Half.pack_sh(&sh, coefficients);
            assert_eq!(words.len(), 2 * Harmonics::Half.words(coefficients));
            let nearest: Vec<f32> = sh.iter().map(|&v| f16::from_f32(v).to_f32()).collect();
            assert_eq!(Harmonics::Half.unpack_sh(&words, coefficients), nearest, "{coefficients} coefficients");
            let words = Harmonics::Full.pack_sh(&sh, coefficients);
            assert_eq!(Harmonics::Full.unpack_sh(&words, coefficients), sh);
        }
    }

    #[test]
    fn what_a_half_cannot_hold_becomes_the_largest_and_what_is_no_number_stays_none() {
        let words = Harmonics::Half.pack_sh(&[1e6, -1e30, f32::NAN], 1);
        let back = Harmonics::Half.unpack_sh(&words, 1);
        assert_eq!(back[..2], [65504.0, -65504.0]);
        assert!(back[2].is_nan());
        assert_eq!(Harmonics::Half.unpack_sh(&Harmonics::Half.pack_sh(&[f32::INFINITY; 3], 1), 1), [f32::INFINITY; 3]);
    }
}
