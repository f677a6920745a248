//! Which photo each triangle is laid out in.

use super::view::View;
use crate::mesh::Mesh;
use glam::Vec3;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::HashMap;

/// Photos of a triangle that are looked at for its texels, those with the most pixels first.
const MOST: usize = 12;
/// A photo may have this part of the pixels of the best one, so that few photos have large patches.
const ENOUGH: f32 = 0.6;
/// The same where two neighbours have that photo.
const ENOUGH_BESIDE: f32 = 0.2;
/// The same in small patches.
const ENOUGH_IN_SMALL: f32 = 0.05;
/// A triangle follows no photo that has more pixels of it than this many times the neighbour's, or its best photo's: it may lie
/// beside that photo, close to the camera.
const TOO_DENSE: f32 = 4.0;
/// Patches of fewer triangles are small.
const SMALL: usize = 32;
/// Times that the labels are compared with their neighbours'.
const SWEEPS: usize = 10;
/// No triangle beyond an edge.
pub const NONE: u32 = u32::MAX;

/// A photo that sees some of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Index of its view.
    pub view: u32,
    /// Pixels of the photo for one unit of area.
    pub density: f32,
}

/// The photos that see some of each triangle.
pub fn candidates(mesh: &Mesh, views: &[View]) -> Vec<Vec<Candidate>> {
    let of_triangle = |triangle: &[u32; 3]| {
        let corners = triangle.map(|i| Vec3::from(mesh.positions[i as usize]));
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        // That of the vertices is smoother than the triangle's own.
        let normal: Vec3 = triangle.iter().map(|&i| Vec3::from(mesh.normals[i as usize])).sum();
        let normal = normal.normalize_or_zero();
        let of_view = |(index, view): (usize, &View)| {
            let density = view.density(middle, normal);
            let sees = || corners.into_iter().chain([middle]).any(|point| view.sees(point) > 0.0);
            (density > 0.0 && sees()).then_some(Candidate { view: index as u32, density })
        };
        let mut found: Vec<Candidate> = views.iter().enumerate().filter_map(of_view).collect();
        found.sort_by(|a, b| b.density.total_cmp(&a.density));
        found.truncate(MOST);
        found
    };
    mesh.triangles.par_iter().map(of_triangle).collect()
}

/// The triangle beyond each edge (corners 0 to 1, 1 to 2, 2 to 0), or [`NONE`].
pub fn neighbours(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let edges = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]];
    let mut owner: HashMap<[u32; 2], u32> = HashMap::with_capacity(3 * triangles.len());
    for (index, triangle) in (0..).zip(triangles) {
        owner.extend(edges(triangle).map(|edge| (edge, index)));
    }
    let beyond = |[a, b]: [u32; 2]| owner.get(&[b, a]).copied().unwrap_or(NONE);
    triangles.iter().map(|triangle| edges(triangle).map(beyond)).collect()
}

/// A photo for each triangle to be laid out in; none where it faces no photo that it may have. The colours do not depend on it, so
/// large patches matter more than the best photo, which need not even see the triangle.
pub struct Labels<'a> {
    /// The photos that see some of each triangle.
    pub candidates: &'a [Vec<Candidate>],
    /// The triangles beyond the edges of each.
    pub neighbours: &'a [[u32; 3]],
    /// Pixels that a triangle has in a view for one unit of area; not positive where it looks away.
    pub density: &'a (dyn Fn(u32, u32) -> f32 + Sync),
}

/// A labelled neighbour of a triangle.
struct Beside {
    at: u32,
    view: u32,
    /// Triangles of its patch.
    size: usize,
}

impl Labels<'_> {
    /// The photo that has enough pixels for the most triangles is taken first. Afterwards a triangle follows two neighbours that
    /// agree, and in a small patch one that is in a larger one.
    pub fn find(&self, views: usize) -> Vec<Option<u32>> {
        let (mut labels, best) = self.cover(views);
        for _ in 0..SWEEPS {
            let sizes = self.patch_sizes(&labels);
            let mut changed = 0;
            for triangle in 0..labels.len() {
                let others = self.neighbours[triangle].into_iter().filter(|&other| other != NONE);
                let around: Vec<Beside> = others
                    .filter_map(|at| Some(Beside { at, view: labels[at as usize]?, size: sizes[at as usize] }))
                    .filter(|beside| Some(beside.view) != labels[triangle])
                    .collect();
                let agreed = around.iter().find(|one| around.iter().filter(|other| other.view == one.view).count() > 1);
                let is_small = labels[triangle].is_none() || sizes[triangle] < SMALL;
                let larger = around.iter().filter(|one| is_small && one.size > sizes[triangle]);
                let mut wanted = agreed.into_iter().chain(larger.max_by_key(|one| one.size));
                let least = best[triangle] * if is_small { ENOUGH_IN_SMALL } else { ENOUGH_BESIDE };
                let fits = |one: &&Beside| {
                    let density = (self.density)(triangle as u32, one.view);
                    density > least && density <= TOO_DENSE * best[triangle].max((self.density)(one.at, one.view))
                };
                if let Some(beside) = wanted.find(fits) {
                    labels[triangle] = Some(beside.view);
                    changed += 1;
                }
            }
            if changed == 0 {
                break;
            }
        }
        labels
    }

    /// Labels without regard to neighbours, and the largest density of each triangle.
    fn cover(&self, views: usize) -> (Vec<Option<u32>>, Vec<f32>) {
        let choices_of = |triangle: usize| -> (Vec<u32>, f32) {
            let density = |one: &Candidate| ((self.density)(triangle as u32, one.view), one.view);
            let densities: Vec<(f32, u32)> = self.candidates[triangle].iter().map(density).collect();
            let best = densities.iter().map(|(density, _)| *density).fold(0.0, f32::max);
            let enough = densities.iter().filter(|(density, _)| *density > 0.0 && *density >= ENOUGH * best);
            (enough.map(|(_, view)| *view).collect(), best)
        };
        let (choices, best): (Vec<_>, Vec<_>) = (0..self.candidates.len()).into_par_iter().map(choices_of).unzip();
        let mut open: Vec<Vec<u32>> = vec![Vec::new(); views];
        for (triangle, choices) in (0..).zip(&choices) {
            choices.iter().for_each(|&view| open[view as usize].push(triangle));
        }
        let mut left: Vec<usize> = open.iter().map(Vec::len).collect();
        let mut labels = vec![None; choices.len()];
        while let Some(view) = (0..views).filter(|&view| left[view] > 0).min_by_key(|&view| (Reverse(left[view]), view))
        {
            for triangle in std::mem::take(&mut open[view]) {
                let label = &mut labels[triangle as usize];
                if label.is_none() {
                    *label = Some(view as u32);
                    choices[triangle as usize].iter().for_each(|&other| left[other as usize] -= 1);
                }
            }
        }
        (labels, best)
    }

    /// Number of triangles in each triangle's patch of one label.
    fn patch_sizes(&self, labels: &[Option<u32>]) -> Vec<usize> {
        let mut sizes = vec![0; labels.len()];
        for first in 0..labels.len() {
            if sizes[first] > 0 {
                continue;
            }
            sizes[first] = 1;
            let mut patch = vec![first];
            let mut next = 0;
            while let Some(&triangle) = patch.get(next) {
                next += 1;
                for other in self.neighbours[triangle].into_iter().filter(|&other| other != NONE) {
                    let other = other as usize;
                    if sizes[other] == 0 && labels[other] == labels[first] {
                        sizes[other] = 1;
                        patch.push(other);
                    }
                }
            }
            patch.iter().for_each(|&triangle| sizes[triangle] = next);
        }
        sizes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(view: u32, density: f32) -> Candidate {
        Candidate { view, density }
    }

    /// Labels where a photo has as many pixels as the candidates say, and 0.5 where it is none.
    fn labels(candidates: &[Vec<Candidate>], neighbours: &[[u32; 3]], views: usize) -> Vec<Option<u32>> {
        let density = |triangle: u32, view: u32| {
            candidates[triangle as usize].iter().find(|one| one.view == view).map_or(0.5, |one| one.density)
        };
        Labels { candidates, neighbours, density: &density }.find(views)
    }

    #[test]
    fn few_photos_with_enough_pixels_are_taken() {
        let apart = [[NONE; 3]; 5];
        // View 2 is best for one, and has enough for three; view 0 has too few for the fourth.
        let wide = vec![seen(0, 1.0), seen(2, 0.9)];
        let candidates =
            [wide.clone(), wide, vec![seen(2, 1.0), seen(0, 0.5)], vec![seen(1, 1.0), seen(0, 0.5)], vec![]];
        assert_eq!(labels(&candidates, &apart, 3), [Some(2), Some(2), Some(2), Some(1), None]);
    }

    #[test]
    fn a_triangle_follows_its_neighbours() {
        let strip = [[0, 1, 2], [1, 3, 2], [2, 3, 4]];
        let beyond = neighbours(&strip);
        assert_eq!(beyond, [[NONE, 1, NONE], [NONE, 2, 0], [1, NONE, NONE]]);
        let ends = vec![seen(0, 1.0)];
        // Less than enough by itself, but beside two that have the photo.
        assert_eq!(labels(&[ends.clone(), vec![seen(1, 1.0), seen(0, 0.4)], ends.clone()], &beyond, 2), [Some(0); 3]);
        let too_few = vec![seen(1, 1.0), seen(0, 0.03)];
        assert_eq!(labels(&[ends.clone(), too_few, ends.clone()], &beyond, 2), [Some(0), Some(1), Some(0)]);
        // One that no photo sees is laid out with the others.
        assert_eq!(labels(&[ends.clone(), ends, vec![]], &beyond, 2), [Some(0); 3]);
    }
}
