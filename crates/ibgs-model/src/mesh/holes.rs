//! Holes of a mesh, closed by the triangles of least area between their edges (Barequet and Sharir, 1995).

use super::Mesh;
use glam::Vec3;
use std::collections::{HashMap, HashSet};

/// Least mean cosine between a hole's normal and those of its vertices: 1 in a plane, 0 at the end of a tube, -1 at the outer
/// border of a plane.
const LEAST_COSINE: f32 = -0.25;

/// Most edges of a hole that may be closed: the time grows with their cube.
pub const MOST_HOLE_EDGES: usize = 1000;

impl Mesh {
    /// Closes holes of at most `most` edges, with no new vertices, and returns their number. The outer border of a piece is no
    /// hole.
    pub fn fill_holes(&mut self, most: usize) -> usize {
        let border = Border::of(&self.triangles);
        let mut filled = 0;
        for ring in border.rings(most.min(MOST_HOLE_EDGES)) {
            let Some(patch) = self.patch(&ring, &border.joined) else { continue };
            let area: Vec3 = patch.iter().map(|&triangle| self.area(triangle)).sum();
            let around: Vec3 = ring.iter().map(|&v| Vec3::from(self.normals[v as usize])).sum();
            if area.dot(around) >= LEAST_COSINE * area.length() * ring.len() as f32 {
                self.triangles.extend(patch);
                filled += 1;
            }
        }
        filled
    }

    /// Normal of a triangle, as long as twice its area.
    pub(super) fn area(&self, triangle: [u32; 3]) -> Vec3 {
        let [a, b, c] = triangle.map(|i| Vec3::from(self.positions[i as usize]));
        (b - a).cross(c - a)
    }

    /// The triangles of least area that close a ring; none where each choice would put a third triangle on an edge.
    fn patch(&self, ring: &[u32], joined: &HashSet<[u32; 2]>) -> Option<Vec<[u32; 3]>> {
        let n = ring.len();
        // The least area between vertices i to j, and the third corner of the triangle on the line from i to j.
        let mut least = vec![(0.0_f32, 0_usize); n * n];
        for span in 2..n {
            for i in 0..n - span {
                let j = i + span;
                let is_diagonal = span < n - 1;
                if is_diagonal && joined.contains(&sorted(ring[i], ring[j])) {
                    least[i * n + j] = (f32::INFINITY, i + 1);
                    continue;
                }
                let with = |k: usize| {
                    let own = self.area([ring[i], ring[k], ring[j]]).length();
                    (least[i * n + k].0 + least[k * n + j].0 + own, k)
                };
                let best = (i + 1..j).map(with).min_by(|a, b| a.0.total_cmp(&b.0));
                least[i * n + j] = best.expect("a vertex between two that are not neighbours");
            }
        }
        if !least[n - 1].0.is_finite() {
            return None;
        }
        let (mut patch, mut open) = (Vec::with_capacity(n - 2), vec![(0, n - 1)]);
        while let Some((i, j)) = open.pop() {
            if j - i > 1 {
                let k = least[i * n + j].1;
                patch.push([ring[i], ring[k], ring[j]]);
                open.extend([(i, k), (k, j)]);
            }
        }
        Some(patch)
    }
}

fn sorted(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Edges with one triangle.
struct Border {
    /// Where a hole goes on after each of its vertices: against the direction of the triangle.
    next: HashMap<u32, Vec<u32>>,
    /// Edges between two vertices of the border.
    joined: HashSet<[u32; 2]>,
}

impl Border {
    fn of(triangles: &[[u32; 3]]) -> Self {
        let edges = || triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let mut count: HashMap<[u32; 2], i32> = HashMap::with_capacity(2 * triangles.len());
        edges().for_each(|[a, b]| *count.entry(sorted(a, b)).or_default() += 1);
        let mut next: HashMap<u32, Vec<u32>> = HashMap::new();
        for [a, b] in edges().filter(|&[a, b]| count[&sorted(a, b)] == 1) {
            next.entry(b).or_default().push(a);
        }
        let joined = count.into_keys().filter(|edge| edge.iter().all(|v| next.contains_key(v))).collect();
        Self { next, joined }
    }

    /// Rings of the border of 3 to `most` edges. Where several meet at a vertex each is one of its own.
    fn rings(&self, most: usize) -> Vec<Vec<u32>> {
        let mut open = self.next.clone();
        let mut firsts: Vec<u32> = open.keys().copied().collect();
        firsts.sort_unstable();
        let (mut rings, mut path, mut place) = (Vec::new(), Vec::new(), HashMap::new());
        for first in firsts {
            let mut at = first;
            while let Some(next) = open.get_mut(&at).and_then(Vec::pop) {
                place.insert(at, path.len());
                path.push(at);
                at = next;
                if let Some(start) = place.get(&at).copied() {
                    let ring = path.split_off(start);
                    for vertex in &ring {
                        place.remove(vertex);
                    }
                    if (3..=most).contains(&ring.len()) {
                        rings.push(ring);
                    }
                }
            }
            path.clear();
            place.clear();
        }
        rings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 6 x 6 cells in the plane z = 0 without those that `is_open` names.
    fn plane(is_open: impl Fn(u32, u32) -> bool) -> Mesh {
        let positions = (0..49).map(|i| [(i % 7) as f32, (i / 7) as f32, 0.0]).collect();
        let cells = (0..36).map(|i| (i % 6, i / 6)).filter(|&(x, y)| !is_open(x, y));
        let triangles = cells.map(|(x, y)| 7 * y + x).flat_map(|a| [[a, a + 1, a + 7], [a + 1, a + 8, a + 7]]);
        let mut mesh = Mesh { positions, colors: vec![[9; 3]; 49], triangles: triangles.collect(), ..Mesh::default() };
        mesh.find_normals();
        mesh
    }

    /// Twice the signed area; it counts a triangle that lies on another one, or looks down, wrongly.
    fn area(mesh: &Mesh) -> f32 {
        mesh.triangles.iter().map(|&triangle| mesh.area(triangle).z).sum()
    }

    fn most_triangles_of_an_edge(mesh: &Mesh) -> usize {
        let mut count: HashMap<[u32; 2], usize> = HashMap::new();
        for [a, b, c] in mesh.triangles.iter().copied() {
            [[a, b], [b, c], [c, a]].iter().for_each(|&edge| *count.entry(edge).or_default() += 1);
        }
        count.into_values().max().unwrap()
    }

    #[test]
    fn holes_of_a_plane_are_filled_up_to_a_size_and_its_border_stays() {
        // One cell, four edges; a corner of three, eight edges.
        let mut mesh = plane(|x, y| (x, y) == (4, 1) || [(1, 3), (2, 3), (1, 4)].contains(&(x, y)));
        let before = mesh.triangles.len();
        assert_eq!((mesh.fill_holes(3), mesh.triangles.len()), (0, before));
        assert_eq!((mesh.fill_holes(7), mesh.triangles.len(), area(&mesh)), (1, before + 2, 66.0));
        assert_eq!((mesh.fill_holes(100), mesh.triangles.len(), area(&mesh)), (1, before + 8, 72.0));
        assert_eq!((mesh.fill_holes(100), most_triangles_of_an_edge(&mesh), mesh.positions.len()), (0, 1, 49));
    }

    #[test]
    fn holes_that_touch_are_two() {
        let mut mesh = plane(|x, y| (x, y) == (2, 2) || (x, y) == (3, 3));
        assert_eq!((mesh.fill_holes(4), area(&mesh), most_triangles_of_an_edge(&mesh)), (2, 72.0, 1));
    }

    /// All but the top of a cube, whose four edges are the hole.
    #[test]
    fn an_open_box_is_closed() {
        let positions: Vec<[f32; 3]> = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|v| v as f32)).collect();
        let quads = [[0, 2, 3, 1], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let mut mesh = Mesh { colors: vec![[0; 3]; 8], positions, triangles, ..Mesh::default() };
        mesh.find_normals();
        assert_eq!((mesh.fill_holes(4), mesh.triangles.len()), (1, 12));
        assert!(mesh.triangles[10..].iter().all(|&triangle| mesh.area(triangle).z > 0.9), "{:?}", mesh.triangles);
    }
}
