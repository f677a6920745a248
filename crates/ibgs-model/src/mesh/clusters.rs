//! Connected pieces of a mesh.

use super::Mesh;
use std::cmp::Reverse;

/// Joins of vertices into pieces; each root stands for its piece.
struct Pieces(Vec<u32>);

impl Pieces {
    fn root(&mut self, mut vertex: u32) -> u32 {
        while self.0[vertex as usize] != vertex {
            let parent = self.0[vertex as usize];
            self.0[vertex as usize] = self.0[parent as usize];
            vertex = parent;
        }
        vertex
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        let (low, high) = (a.min(b), a.max(b));
        self.0[high as usize] = low;
    }
}

impl Mesh {
    /// Keeps the `most` connected pieces with the most triangles (all of them at 0), drops vertices that no triangle uses, and
    /// returns how many pieces there were.
    pub fn keep_largest(&mut self, most: usize) -> usize {
        let mut pieces = Pieces((0..self.positions.len() as u32).collect());
        for &[a, b, c] in &self.triangles {
            pieces.join(a, b);
            pieces.join(a, c);
        }
        let mut triangles = vec![0_u32; self.positions.len()];
        for &[a, ..] in &self.triangles {
            triangles[pieces.root(a) as usize] += 1;
        }
        let mut roots: Vec<u32> = (0..triangles.len() as u32).filter(|&v| triangles[v as usize] > 0).collect();
        let count = roots.len();
        roots.sort_by_key(|&root| (Reverse(triangles[root as usize]), root));
        if most > 0 {
            roots.truncate(most);
        }
        let mut kept = vec![false; self.positions.len()];
        for root in roots {
            kept[root as usize] = true;
        }
        self.triangles.retain(|&[a, ..]| kept[pieces.root(a) as usize]);
        self.drop_unused();
        count
    }

    /// Drops vertices that no triangle uses.
    pub(super) fn drop_unused(&mut self) {
        const UNUSED: u32 = u32::MAX;
        let mut renamed = vec![UNUSED; self.positions.len()];
        for &vertex in self.triangles.as_flattened() {
            renamed[vertex as usize] = 0;
        }
        for (next, name) in (0..).zip(renamed.iter_mut().filter(|name| **name != UNUSED)) {
            *name = next;
        }
        let used = |i: usize| renamed[i] != UNUSED;
        retain(&mut self.positions, used);
        retain(&mut self.normals, used);
        retain(&mut self.colors, used);
        for vertex in self.triangles.as_flattened_mut() {
            *vertex = renamed[*vertex as usize];
        }
    }
}

fn retain<T>(values: &mut Vec<T>, keep: impl Fn(usize) -> bool) {
    let mut index = 0;
    values.retain(|_| {
        index += 1;
        keep(index - 1)
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_pieces_stay_with_their_vertices() {
        // A strip of two triangles, a lone vertex, a triangle, a strip of three.
        let triangles = vec![[0, 1, 2], [1, 2, 3], [5, 6, 7], [8, 9, 10], [9, 10, 11], [10, 11, 12]];
        let of = |i: u32| [i as f32, 0.0, 0.0];
        let positions: Vec<_> = (0..13).map(of).collect();
        let colors = (0..13).map(|i| [i; 3]).collect();
        let whole = Mesh { normals: positions.clone(), positions, colors, triangles, ..Mesh::default() };
        let mut mesh = whole.clone();
        assert_eq!(mesh.keep_largest(2), 3);
        assert_eq!(mesh.triangles, [[0, 1, 2], [1, 2, 3], [4, 5, 6], [5, 6, 7], [6, 7, 8]]);
        let expected: Vec<_> = [0, 1, 2, 3, 8, 9, 10, 11, 12].map(of).into();
        assert_eq!((&mesh.positions, &mesh.normals), (&expected, &expected));
        assert_eq!(mesh.colors[4], [8; 3]);
        let mut mesh = whole;
        assert_eq!((mesh.keep_largest(0), mesh.triangles.len(), mesh.positions.len()), (3, 6, 12));
    }
}
