//! Gaussians that hang together: what a flood reaches, and what floats apart from the model.
//!
//! Space is divided into cubes. Gaussians whose cubes are one or touch each other, be it at a corner, are of one group.

use super::values::opacity;
use super::{Mask, nearest, place};
use crate::scene::Gaussians;
use glam::{DVec3, I64Vec3};
use std::collections::HashMap;

/// Fainter Gaussians hold nothing together.
const FAINT: f64 = 0.1;

/// Cubes with Gaussians in them, and the group of each.
struct Groups {
    /// Side of a cube in scene units.
    side: f64,
    /// Number of Gaussians and group of a cube.
    cubes: HashMap<I64Vec3, (usize, usize)>,
    /// Gaussians of each group.
    sizes: Vec<usize>,
}

fn around(cube: I64Vec3) -> impl Iterator<Item = I64Vec3> {
    let side = || -1..=1;
    side().flat_map(move |x| side().flat_map(move |y| side().map(move |z| cube + I64Vec3::new(x, y, z))))
}

impl Groups {
    fn of(gaussians: &Gaussians, among: impl Iterator<Item = usize>, side: f64) -> Self {
        let mut groups = Self { side, cubes: HashMap::new(), sizes: Vec::new() };
        // Cubes in the order of their first Gaussian, so that groups do not depend on the order of a map.
        let mut order = Vec::new();
        for i in among {
            let cube = groups.cube(place(gaussians, i));
            let (count, _) = groups.cubes.entry(cube).or_insert_with(|| {
                order.push(cube);
                (0, usize::MAX)
            });
            *count += 1;
        }
        for cube in order {
            groups.spread(cube);
        }
        groups
    }

    fn cube(&self, place: DVec3) -> I64Vec3 {
        (place / self.side).floor().as_i64vec3()
    }

    /// Makes a group of a cube and of all that hang together with it, where it has none.
    fn spread(&mut self, from: I64Vec3) {
        let group = self.sizes.len();
        let mut size = 0;
        let mut ahead = vec![from];
        while let Some(cube) = ahead.pop() {
            let Some((count, of)) = self.cubes.get_mut(&cube).filter(|(_, of)| *of == usize::MAX) else { continue };
            (*of, size) = (group, size + *count);
            ahead.extend(around(cube));
        }
        if size > 0 {
            self.sizes.push(size);
        }
    }

    fn group(&self, place: DVec3) -> Option<usize> {
        self.cubes.get(&self.cube(place)).map(|(_, group)| *group)
    }
}

/// What hangs together with a place.
#[derive(Clone, Copy, Debug)]
pub struct Flood {
    /// It begins at the Gaussian whose centre is nearest.
    pub start: DVec3,
    /// Side of the cubes in scene units: larger gaps are not crossed.
    pub gap: f64,
    /// Only Gaussians whose colours differ by no more than this from the first one's; none: of any colour.
    pub tolerance: Option<f64>,
}

impl Flood {
    /// The Gaussians of a mask that it reaches.
    pub fn found(&self, gaussians: &Gaussians, among: &Mask) -> Mask {
        let Some(first) = nearest(gaussians, among, self.start).filter(|_| self.gap > 0.0) else {
            return Mask::none(gaussians.len());
        };
        let among = match self.tolerance {
            Some(tolerance) => among.and(&of_color(gaussians, color(gaussians, first), tolerance)),
            None => among.clone(),
        };
        let groups = Groups::of(gaussians, among.iter(), self.gap);
        let group = groups.group(place(gaussians, first));
        Mask::of(gaussians.len(), |i| among.has(i) && groups.group(place(gaussians, i)) == group)
    }
}

/// Groups that are too small to be part of the model.
#[derive(Clone, Copy, Debug)]
pub struct Floaters {
    /// Side of the cubes in scene units: what is farther from the rest floats.
    pub gap: f64,
    /// Groups of fewer Gaussians float.
    pub least: usize,
}

impl Floaters {
    /// The Gaussians of a mask that float. Faint ones hold nothing together: they float where no large group is near.
    pub fn found(&self, gaussians: &Gaussians, among: &Mask) -> Mask {
        if self.gap <= 0.0 {
            return Mask::none(gaussians.len());
        }
        let solid = among.iter().filter(|&i| opacity(gaussians, i) >= FAINT);
        let groups = Groups::of(gaussians, solid, self.gap);
        let is_large = |cube: I64Vec3| groups.cubes.get(&cube).is_some_and(|(_, of)| groups.sizes[*of] >= self.least);
        Mask::of(gaussians.len(), |i| among.has(i) && !around(groups.cube(place(gaussians, i))).any(is_large))
    }
}

/// Colour of a Gaussian without what depends on the direction: red, green, blue, 0 to 1 and beyond.
pub fn color(gaussians: &Gaussians, index: usize) -> DVec3 {
    let dc = &gaussians.sh[3 * gaussians.sh_coefficients() * index..];
    0.5 + crate::scene::SH_C0 * DVec3::new(dc[0].into(), dc[1].into(), dc[2].into())
}

/// The Gaussians whose colour is no farther than this from another one, as points in the cube of red, green and blue.
pub fn of_color(gaussians: &Gaussians, wanted: DVec3, tolerance: f64) -> Mask {
    Mask::of(gaussians.len(), |i| color(gaussians, i).distance(wanted) <= tolerance)
}

#[cfg(test)]
mod tests {
    use super::super::tests::grid;
    use super::*;

    /// The grid in two halves by colour, a pair of points apart from it, and a faint one between.
    fn apart() -> Gaussians {
        let mut gaussians = grid();
        for point in [DVec3::new(20.0, 0.0, 0.0), DVec3::new(21.0, 0.0, 0.0), DVec3::new(11.0, 0.0, 0.0)] {
            gaussians.means.push(gaussians.space.to_local(point).as_vec3().to_array());
            gaussians.log_scales.push([0.0; 3]);
            gaussians.opacity_logits.push(5.0);
        }
        gaussians.opacity_logits.iter_mut().for_each(|logit| *logit = 5.0);
        *gaussians.opacity_logits.last_mut().unwrap() = -5.0;
        gaussians.sh =
            (0..gaussians.len()).flat_map(|i| [if place(&gaussians, i).x < 0.5 { -1.0 } else { 1.0 }; 3]).collect();
        gaussians
    }

    #[test]
    fn a_flood_goes_as_far_as_gaps_and_colours_let_it() {
        let gaussians = apart();
        let all = Mask::all(gaussians.len());
        let flood = Flood { start: DVec3::new(3.2, 0.0, 0.0), gap: 1.2, tolerance: None };
        let count = |flood: Flood| flood.found(&gaussians, &all).count();
        assert_eq!(count(flood), 343, "the grid");
        assert_eq!(count(Flood { start: DVec3::new(30.0, 0.0, 0.0), ..flood }), 2, "the pair");
        assert_eq!(count(Flood { gap: 9.5, ..flood }), 346, "all is near");
        assert_eq!(count(Flood { tolerance: Some(0.1), ..flood }), 3 * 49, "the bright half");
        assert_eq!(count(Flood { tolerance: Some(2.0), ..flood }), 343);
        // What is not among those that count is no bridge.
        let wall = Mask::of(gaussians.len(), |i| place(&gaussians, i).x == 0.0 || place(&gaussians, i).x == 1.0);
        let found = Flood { gap: 1.0, ..flood }.found(&gaussians, &all.without(&wall));
        assert_eq!(found.count(), 2 * 49);
        for none in [Flood { gap: 0.0, ..flood }.found(&gaussians, &all), flood.found(&gaussians, &Mask::none(346))] {
            assert_eq!(none.count(), 0);
        }
    }

    #[test]
    fn small_groups_float_and_faint_gaussians_are_no_bridge() {
        let gaussians = apart();
        let all = Mask::all(gaussians.len());
        let found = |gap: f64, least: usize| Floaters { gap, least }.found(&gaussians, &all).iter().collect::<Vec<_>>();
        assert_eq!(found(1.2, 10), [343, 344, 345]);
        assert_eq!(found(1.2, 2), [345], "two are enough, and the faint one is near to nothing");
        assert_eq!(found(8.0, 10), [343, 344], "the faint one is near to the grid, and the pair is not");
        assert!(found(20.0, 10).is_empty());
        assert_eq!(found(1.2, 1000).len(), 346);
        assert!(found(0.0, 10).is_empty());
        let pair = Mask::of(346, |i| i >= 343);
        assert_eq!(Floaters { gap: 1.2, least: 10 }.found(&gaussians, &pair).count(), 3);
    }

    #[test]
    fn colours_are_found_by_their_distance() {
        let gaussians = apart();
        let bright = 0.5 + crate::scene::SH_C0;
        assert!(color(&gaussians, 343).abs_diff_eq(DVec3::splat(bright), 1e-12));
        assert_eq!(of_color(&gaussians, DVec3::splat(bright), 0.01).count(), 3 * 49 + 3);
        assert_eq!(of_color(&gaussians, DVec3::splat(bright), 1.0).count(), 346);
        assert_eq!(of_color(&gaussians, DVec3::new(bright, bright, bright - 0.2), 0.1).count(), 0);
    }
}
