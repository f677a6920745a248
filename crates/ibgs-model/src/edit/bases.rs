//! The bases of a model as one list of Gaussians to choose from.

use super::Mask;
use crate::scene::{Gaussians, SH_C0};
use glam::DVec3;
use std::sync::Arc;

/// Part of the tint in the colour of what is marked.
const TINT: f32 = 0.6;

/// The Gaussians of every base of a model; more than one where it is an ensemble.
///
/// A mask of what is chosen is one of a single list, in which the bases follow each other. A base may lose all of its
/// Gaussians: it stays in the ensemble, and its image is the background, so that every other Gaussian keeps its weight in
/// the mean of the images. Bundles hold such a base; levels of detail and most formats of Gaussians need at least one
/// Gaussian in the first.
#[derive(Clone, Debug)]
pub struct Bases {
    first: Arc<Gaussians>,
    further: Vec<Gaussians>,
    joined: Arc<Gaussians>,
}

impl Bases {
    /// The first base and those of the further members.
    pub fn new(first: Gaussians, further: Vec<Gaussians>) -> Self {
        let first = Arc::new(first);
        let joined = if further.is_empty() { first.clone() } else { Arc::new(join(&first, &further)) };
        Self { first, further, joined }
    }

    /// All in one list, in the first one's space. Those of an ensemble have their constant colours alone, as nothing is chosen by
    /// the others.
    pub fn joined(&self) -> &Arc<Gaussians> {
        &self.joined
    }

    /// What a mask of the list leaves of the first base and of the others, every value as it was.
    ///
    /// # Panics
    /// When the mask is one of another number of Gaussians: a bug of ours.
    pub fn left(&self, mask: &Mask) -> (Gaussians, Vec<Gaussians>) {
        self.cut(mask, |_, _| {})
    }

    /// The same with the colours of those of another mask mixed with `tint`, so that they stand out.
    ///
    /// # Panics
    /// As [`Bases::left`].
    pub fn tinted(&self, mask: &Mask, marked: &Mask, tint: DVec3) -> (Gaussians, Vec<Gaussians>) {
        let dc = ((tint - 0.5) / SH_C0).as_vec3().to_array();
        self.cut(mask, |i, sh| {
            if marked.has(i) {
                sh.iter_mut().for_each(|value| *value *= 1.0 - TINT);
                sh.iter_mut().zip(dc).for_each(|(value, dc)| *value += TINT * dc);
            }
        })
    }

    /// All Gaussians of each base in one colour: black what a mask leaves, white what it removes.
    ///
    /// # Panics
    /// As [`Bases::left`].
    pub fn marked(&self, mask: &Mask) -> Vec<Gaussians> {
        let (first, further) = self.cut(&Mask::all(mask.total()), |i, sh| {
            let color = if mask.has(i) { 0.0 } else { 1.0 };
            sh[..3].fill((color - 0.5) / SH_C0 as f32);
        });
        std::iter::once(first).chain(further).map(|base| base.with_sh_degree(0)).collect()
    }

    /// What a mask leaves, after a change of the spherical harmonics by the number in the list.
    fn cut(&self, mask: &Mask, change: impl Fn(usize, &mut [f32])) -> (Gaussians, Vec<Gaussians>) {
        assert_eq!(mask.total(), self.joined.len(), "the mask is of another model");
        let mut start = 0;
        let mut cut = |base: &Gaussians| {
            let own = Mask::of(base.len(), |i| mask.has(start + i));
            let mut left = own.of_model(base);
            let row = 3 * left.sh_coefficients();
            own.iter().zip(left.sh.chunks_exact_mut(row)).for_each(|(i, sh)| change(start + i, sh));
            start += base.len();
            left
        };
        (cut(&self.first), self.further.iter().map(cut).collect())
    }
}

fn join(first: &Gaussians, further: &[Gaussians]) -> Gaussians {
    let mut joined = first.with_sh_degree(0);
    for base in further {
        joined.append(base.in_space(joined.space).with_sh_degree(0));
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::local_space::LocalSpace;
    use ibgs_testing::random_gaussians;

    #[test]
    fn a_single_base_is_its_own_list() {
        let base = random_gaussians(70, 2, 1);
        let bases = Bases::new(base.clone(), Vec::new());
        assert_eq!(**bases.joined(), base);
        let mask = Mask::of(70, |i| i % 3 == 0);
        assert_eq!(bases.left(&mask), (mask.of_model(&base), Vec::new()));
    }

    #[test]
    fn a_mask_is_cut_by_the_bases() {
        let bases = [random_gaussians(70, 1, 1), random_gaussians(33, 3, 2), random_gaussians(5, 0, 3)];
        let [first, second, third] = bases.clone();
        let whole = Bases::new(first, vec![second, third]);
        let places = |base: &Gaussians| base.positions().collect::<Vec<_>>();
        assert!(places(whole.joined()) == bases.iter().flat_map(places).collect::<Vec<_>>());
        whole.joined().validate().unwrap();
        let (first, further) = whole.left(&Mask::all(108));
        assert!([&[first][..], &further].concat() == bases, "every value and degree as it was");
        // The last of the first, some of the second, none of the third.
        let (first, further) = whole.left(&Mask::of(108, |i| [69, 70, 72, 102].contains(&i)));
        assert_eq!(first, bases[0].rows(1, [69].into_iter()));
        assert_eq!(further, [bases[1].rows(3, [0, 2, 32].into_iter()), none(&bases[2])]);
        let (first, further) = whole.left(&Mask::of(108, |i| i == 107));
        assert_eq!((first.len(), further[0].len()), (0, 0));
        assert_eq!(further[1], bases[2].rows(1, [4].into_iter()));
    }

    #[test]
    fn what_is_marked_is_tinted_and_nothing_else() {
        let [first, second] = [random_gaussians(4, 1, 1), random_gaussians(3, 0, 2)];
        let bases = Bases::new(first.clone(), vec![second.clone()]);
        let (all, tint) = (Mask::all(7), DVec3::new(1.0, 0.5, 0.0));
        let marked = Mask::of(7, |i| i == 1 || i == 5);
        assert_eq!(bases.tinted(&all, &Mask::none(7), tint), bases.left(&all));
        let left = Mask::of(7, |i| i > 0);
        let (one, two) = bases.tinted(&left, &marked, tint);
        let (plain, others) = bases.left(&left);
        assert_eq!((&one.means, &one.sh[12..], &two[0].sh[..3]), (&plain.means, &plain.sh[12..], &others[0].sh[..3]));
        let mixed = |index: usize, of: &Gaussians| 0.4 * super::super::color(of, index) + 0.6 * tint;
        assert!(super::super::color(&one, 0).abs_diff_eq(mixed(0, &plain), 1e-5));
        assert!(super::super::color(&two[0], 1).abs_diff_eq(mixed(1, &others[0]), 1e-5));
        assert!(one.sh[3..12].iter().zip(&plain.sh[3..12]).all(|(now, before)| (now - 0.4 * before).abs() < 1e-6));
    }

    #[test]
    fn what_a_mask_removes_is_white_and_the_rest_black() {
        let [first, second] = [random_gaussians(4, 2, 1), random_gaussians(3, 0, 2)];
        let bases = Bases::new(first.clone(), vec![second]);
        let marked = bases.marked(&Mask::of(7, |i| i != 1 && i != 6));
        assert_eq!(marked.iter().map(|base| (base.len(), base.sh_degree)).collect::<Vec<_>>(), [(4, 0), (3, 0)]);
        let colors = marked.iter().flat_map(|base| (0..base.len()).map(|i| super::super::color(base, i)));
        for (i, color) in colors.enumerate() {
            let wanted = if i == 1 || i == 6 { DVec3::ONE } else { DVec3::ZERO };
            assert!(color.abs_diff_eq(wanted, 1e-6), "{i}: {color}");
        }
        assert_eq!((&marked[0].means, &marked[0].opacity_logits), (&first.means, &first.opacity_logits));
    }

    fn none(base: &Gaussians) -> Gaussians {
        base.rows(0, std::iter::empty())
    }

    #[test]
    fn the_list_is_in_the_space_of_the_first() {
        let [first, second] = [1, 2].map(|seed| random_gaussians(4, 1, seed));
        let space = LocalSpace { origin: DVec3::new(3.0, -2.0, 1.0), scale: 2.0 };
        let bases = Bases::new(first.clone(), vec![Gaussians { space, ..second.clone() }]);
        assert_eq!(bases.joined().space, first.space);
        let moved = Gaussians { space, ..second };
        for (place, expected) in bases.joined().positions().skip(4).zip(moved.positions()) {
            assert!(place.distance(expected) < 1e-5, "{place} {expected}");
        }
        assert_eq!(bases.left(&Mask::all(8)).1, [moved], "what is left is where it was");
    }
}
