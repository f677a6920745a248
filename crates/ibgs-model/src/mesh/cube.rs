//! The cases of marching cubes, made from the topology of the cube.
//!
//! Corner c of a cube lies at (c & 1, c >> 1 & 1, c >> 2 & 1). On every face the cut edges are joined around each run of inside
//! corners. That looks at the face's own corners alone, so both cubes at a face draw the same lines and the surface is closed;
//! the lines of a cube form loops, which become fans of triangles.

use std::sync::LazyLock;

/// An edge of the cube: its lower corner and its axis.
pub(super) const EDGES: [(usize, usize); 12] = [
    (0, 0),
    (2, 0),
    (4, 0),
    (6, 0), // along x
    (0, 1),
    (1, 1),
    (4, 1),
    (5, 1), // along y
    (0, 2),
    (1, 2),
    (2, 2),
    (3, 2), // along z
];

/// Triangles of each case as edges; bit c of a case is set where corner c lies inside. Counter-clockwise seen from outside.
pub(super) static CASES: LazyLock<Vec<Vec<[u8; 3]>>> = LazyLock::new(|| (0..256).map(triangles).collect());

/// The number of the edge between two corners.
fn edge(a: usize, b: usize) -> usize {
    let wanted = (a.min(b), (a ^ b).trailing_zeros() as usize);
    EDGES.iter().position(|edge| *edge == wanted).expect("neighbouring corners")
}

/// Corners of the six faces, counter-clockwise seen from outside.
fn faces() -> [[usize; 4]; 6] {
    std::array::from_fn(|i| {
        let (axis, side) = (i / 2, i % 2);
        let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        let first = side << axis;
        if side == 1 {
            [first, first | u, first | u | v, first | v]
        } else {
            [first, first | v, first | u | v, first | u]
        }
    })
}

/// Whether two edges border the same face, so that a line between their points lies in it.
fn share_face(a: usize, b: usize) -> bool {
    let has = |face: &[usize; 4], e: usize| (0..4).any(|k| edge(face[k], face[(k + 1) % 4]) == e);
    faces().iter().any(|face| has(face, a) && has(face, b))
}

/// The next edge of the surface's outline after each edge.
fn links(case: usize) -> [Option<usize>; 12] {
    let inside = |corner: usize| case >> corner & 1 == 1;
    let mut next = [None; 12];
    for face in faces() {
        let at = |k: usize| face[k % 4];
        for k in (0..4).filter(|&k| !inside(at(k)) && inside(at(k + 1))) {
            // The run of inside corners that begins after corner k.
            let end = (k + 1..).find(|&j| !inside(at(j + 1))).expect("corner k is outside");
            next[edge(at(k), at(k + 1))] = Some(edge(at(end), at(end + 1)));
        }
    }
    next
}

fn triangles(case: usize) -> Vec<[u8; 3]> {
    let mut next = links(case);
    let mut triangles = Vec::new();
    for first in 0..12 {
        let mut ring = Vec::new();
        let mut at = first;
        while let Some(following) = next[at].take() {
            ring.push(at);
            at = following;
        }
        if ring.is_empty() {
            continue;
        }
        // A diagonal in a face could meet that of the cube behind it: four triangles at one edge.
        let n = ring.len();
        let clean = |start: &usize| (2..n - 1).all(|k| !share_face(ring[*start], ring[(start + k) % n]));
        let start = (0..n).find(clean).unwrap_or(0);
        let corner = |k: usize| ring[(start + k) % n] as u8;
        triangles.extend((1..n - 1).map(|k| [corner(0), corner(k), corner(k + 1)]));
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use std::collections::HashMap;

    fn middle(e: u8) -> Vec3 {
        let (corner, axis) = EDGES[usize::from(e)];
        let mut p = Vec3::new((corner & 1) as f32, (corner >> 1 & 1) as f32, (corner >> 2) as f32);
        p[axis] += 0.5;
        p
    }

    #[test]
    fn every_case_uses_exactly_its_cut_edges() {
        for (case, triangles) in CASES.iter().enumerate() {
            let inside = |corner: usize| case >> corner & 1 == 1;
            let cut = |&(corner, axis): &(usize, usize)| inside(corner) != inside(corner | 1 << axis);
            for (e, found) in EDGES.iter().enumerate() {
                let used = triangles.iter().flatten().any(|&t| usize::from(t) == e);
                assert_eq!(used, cut(found), "case {case}, edge {e}");
            }
        }
        assert!(CASES[0].is_empty() && CASES[255].is_empty());
        assert!(CASES.iter().all(|triangles| triangles.len() <= 5));
    }

    #[test]
    fn single_corners_look_away_from_the_inside() {
        for corner in 0..8 {
            let inside = Vec3::new((corner & 1) as f32, (corner >> 1 & 1) as f32, (corner >> 2) as f32);
            let [triangle] = CASES[1 << corner][..] else { panic!("{:?}", CASES[1 << corner]) };
            let [a, b, c] = triangle.map(middle);
            assert!((b - a).cross(c - a).dot(a - inside) > 0.0, "corner {corner}");
        }
    }

    /// Inner edges lie between two triangles, those of the outline in exactly one face of the cube.
    #[test]
    fn no_inner_edge_lies_in_a_face() {
        for (case, triangles) in CASES.iter().enumerate() {
            let mut count: HashMap<[u8; 2], usize> = HashMap::new();
            for [a, b, c] in triangles.iter().copied() {
                for [a, b] in [[a, b], [b, c], [c, a]] {
                    *count.entry([a.min(b), a.max(b)]).or_default() += 1;
                }
            }
            for ([a, b], n) in count {
                let in_face = share_face(a.into(), b.into());
                assert_eq!(n, if in_face { 1 } else { 2 }, "case {case}, edge {a} {b}");
            }
        }
    }
}
