//! Places of two photos each become tracks of many.

use super::features::Features;
use crate::adjust::{Seen, Track};
use std::collections::BTreeMap;

/// The root of a tree of numbers, which becomes lower on the way.
fn root(parents: &mut [usize], mut at: usize) -> usize {
    while parents[at] != at {
        parents[at] = parents[parents[at]];
        at = parents[at];
    }
    at
}

/// Tracks of all places that are joined by matches of pairs of photos; not those that have two places of one photo.
pub(super) fn joined(found: &[Features], pairs: &[[usize; 2]], matches: &[Vec<[usize; 2]>]) -> Vec<Track> {
    let first: Vec<usize> =
        found.iter().scan(0, |sum, features| Some(std::mem::replace(sum, *sum + features.places.len()))).collect();
    let count = found.iter().map(|features| features.places.len()).sum();
    let mut parents: Vec<usize> = (0..count).collect();
    for ([a, b], places) in pairs.iter().zip(matches) {
        for [at, other] in places {
            let (at, other) = (root(&mut parents, first[*a] + at), root(&mut parents, first[*b] + other));
            parents[at.max(other)] = at.min(other);
        }
    }
    let mut tracks: BTreeMap<usize, Vec<Seen>> = BTreeMap::new();
    for (view, features) in found.iter().enumerate() {
        for (place, &pixel) in features.places.iter().enumerate() {
            tracks.entry(root(&mut parents, first[view] + place)).or_default().push(Seen { view, pixel });
        }
    }
    let is_one = |seen: &Vec<Seen>| seen.len() > 1 && seen.windows(2).all(|two| two[0].view != two[1].view);
    tracks.into_values().filter(is_one).map(|seen| Track { position: None, seen }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    #[test]
    fn places_are_joined_over_photos_and_contradictions_dropped() {
        let features = |count: usize| Features {
            places: (0..count).map(|i| DVec2::splat(i as f64)).collect(),
            descriptors: Vec::new(),
        };
        let found = [features(3), features(2), features(3)];
        // 0.0, 1.1 and 2.2 are one; 0.1 and 0.2 are said to be the same place, 1.0; 2.0 is nobody's.
        let matches = [vec![[0, 1], [1, 0], [2, 0]], vec![[1, 2]]];
        let tracks = joined(&found, &[[0, 1], [1, 2]], &matches);
        let seen = |view, pixel: f64| Seen { view, pixel: DVec2::splat(pixel) };
        assert_eq!(tracks, [Track { position: None, seen: vec![seen(0, 0.0), seen(1, 1.0), seen(2, 2.0)] }]);
    }
}
