//! Which Gaussians of a model, one bit each.

use crate::scene::Gaussians;
use rayon::prelude::*;

const BITS: usize = u64::BITS as usize;

/// Some of the Gaussians of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Bits behind the last Gaussian are 0.
    words: Vec<u64>,
    total: usize,
}

impl Mask {
    /// None of `total` Gaussians.
    pub fn none(total: usize) -> Self {
        Self { words: vec![0; total.div_ceil(BITS)], total }
    }

    /// All of them.
    pub fn all(total: usize) -> Self {
        Self::of(total, |_| true)
    }

    /// Those of an index that `chosen` names.
    pub fn of(total: usize, chosen: impl Fn(usize) -> bool + Sync) -> Self {
        let word = |at: usize| {
            let bits = (BITS * at..total.min(BITS * (at + 1))).enumerate();
            bits.fold(0, |word, (bit, index)| word | u64::from(chosen(index)) << bit)
        };
        Self { words: (0..total.div_ceil(BITS)).into_par_iter().with_min_len(64).map(word).collect(), total }
    }

    /// Gaussians of the model.
    pub fn total(&self) -> usize {
        self.total
    }

    /// Gaussians in the mask.
    pub fn count(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Whether one is in it.
    pub fn has(&self, index: usize) -> bool {
        self.words.get(index / BITS).is_some_and(|word| word >> (index % BITS) & 1 == 1)
    }

    /// Indices of those in it, in order.
    pub fn iter(&self) -> impl Iterator<Item = usize> + Clone {
        self.words.iter().enumerate().flat_map(|(at, &word)| {
            let rest = std::iter::successors(Some(word), |word| Some(word & word.wrapping_sub(1)));
            rest.take_while(|&word| word != 0).map(move |word| BITS * at + word.trailing_zeros() as usize)
        })
    }

    /// The Gaussians of a model that are in it, in their order.
    ///
    /// # Panics
    /// When it is one of another number of Gaussians: a bug of ours.
    pub fn of_model(&self, model: &Gaussians) -> Gaussians {
        assert_eq!(self.total(), model.len(), "the mask is of another model");
        model.rows(self.count(), self.iter())
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        size_of::<u64>() * self.words.len()
    }

    fn with(&self, other: &Self, word: impl Fn(u64, u64) -> u64) -> Self {
        assert_eq!(self.total, other.total, "masks of two models");
        let words = self.words.iter().zip(&other.words).map(|(&a, &b)| word(a, b)).collect();
        Self { words, total: self.total }
    }

    /// Those in both.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        self.with(other, |a, b| a & b)
    }

    /// Those in at least one.
    #[must_use]
    pub fn or(&self, other: &Self) -> Self {
        self.with(other, |a, b| a | b)
    }

    /// Those that are not in the other one.
    #[must_use]
    pub fn without(&self, other: &Self) -> Self {
        self.with(other, |a, b| a & !b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_are_sets() {
        for total in [0, 1, 63, 64, 65, 10_000] {
            let thirds = Mask::of(total, |i| i % 3 == 0);
            let even = Mask::of(total, |i| i % 2 == 0);
            let listed = |wanted: &dyn Fn(usize) -> bool| (0..total).filter(|&i| wanted(i)).collect::<Vec<_>>();
            assert!(thirds.iter().eq(listed(&|i| i % 3 == 0)));
            assert!(thirds.and(&even).iter().eq(listed(&|i| i % 6 == 0)));
            assert!(thirds.or(&even).iter().eq(listed(&|i| i % 3 == 0 || i % 2 == 0)));
            assert!(thirds.without(&even).iter().eq(listed(&|i| i % 6 == 3)));
            assert_eq!((Mask::all(total).count(), Mask::none(total).count()), (total, 0));
            assert_eq!(thirds.count(), total.div_ceil(3));
            assert!(!Mask::all(total).has(total));
            assert_eq!(Mask::all(total).without(&thirds).count(), total - thirds.count());
        }
    }
}
