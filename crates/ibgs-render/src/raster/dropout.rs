//! Dropout of Gaussians: a random share of them is left out of an iteration.
//!
//! After enough iterations the base image fits the training photos far better than photos it was not trained on. A network
//! that only ever sees that good base learns to add nothing, and its gain on other views fades. With some Gaussians
//! missing, the base errs in training as it does elsewhere, and no Gaussian can rely on another to make up for it.
//! A departure from method.md; the idea for plain splatting with few photos is that of Park, Ryu and Kim, "DropGaussian",
//! CVPR 2025. Unlike theirs the opacities that remain are not raised.

/// Which Gaussians an iteration leaves out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropout {
    /// A Gaussian is left out when its hash is smaller; 0: none is.
    pub(super) below: u32,
    /// Makes each iteration leave out others.
    pub(super) seed: u32,
}

impl Dropout {
    /// Leaves out about `share` (0 to 1) of all Gaussians, chosen by `seed` and `iteration` alone.
    pub fn new(share: f64, seed: u64, iteration: u32) -> Self {
        let below = (share * f64::from(u32::MAX)) as u32;
        Self { below, seed: iteration_seed(seed, iteration) }
    }

    /// Whether the Gaussian of this index is left out: the twin of the test in `project.wgsl`.
    pub fn drops(&self, index: u32) -> bool {
        hash(index ^ self.seed) < self.below
    }
}

/// The seed of an iteration: another one for each `seed` and `iteration`.
pub fn iteration_seed(seed: u64, iteration: u32) -> u32 {
    hash(hash(hash(iteration) ^ seed as u32) ^ (seed >> 32) as u32)
}

/// PCG hash of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
fn hash(value: u32) -> u32 {
    let state = value.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_is_left_out_and_changes_with_the_iteration() {
        let n = 100_000;
        for share in [0.0, 0.1, 0.7, 1.0] {
            let left_out = |iteration| {
                let dropout = Dropout::new(share, 7, iteration);
                (0..n).map(|i| dropout.drops(i)).collect::<Vec<_>>()
            };
            let (a, b) = (left_out(1), left_out(2));
            let part = |list: &[bool]| list.iter().filter(|&&gone| gone).count() as f64 / f64::from(n);
            assert!((part(&a) - share).abs() < 0.005, "{} of {share}", part(&a));
            // Two iterations agree on the square of the share, as independent draws do.
            let both: Vec<bool> = a.iter().zip(&b).map(|(a, b)| a & b).collect();
            assert!((part(&both) - share * share).abs() < 0.005, "{} of {share} twice", part(&both));
        }
        assert_ne!(Dropout::new(0.1, 0, 5), Dropout::new(0.1, 1, 5));
        assert_ne!(Dropout::new(0.1, 0, 5), Dropout::new(0.1, 1 << 32, 5));
    }
}
