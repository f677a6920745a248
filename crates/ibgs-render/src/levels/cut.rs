//! Which chunks a view needs.

use super::Node;
use crate::camera::Camera;
use glam::{DVec3, Vec3};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Part of its size by which an image is taken larger: what has just left it may come back.
const MARGIN: f64 = 0.1;

/// By error in pixels.
struct Candidate {
    error: f64,
    node: u32,
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error.total_cmp(&other.error).then(other.node.cmp(&self.node))
    }
}

/// Size of a chunk's error in the image of a local camera, in pixels; 0 where the image shows nothing of it.
pub fn error_in(node: &Node, camera: &Camera) -> f64 {
    if node.error == 0.0 || !may_show(node, camera) {
        return 0.0;
    }
    let eye = camera.center().as_vec3();
    let distance = eye.distance(eye.clamp(node.low, node.high));
    camera.focal.max_element() * f64::from(node.error) / f64::from(distance).max(f64::from(ibgs_shaders::NEAR_DEPTH))
}

/// Whether the ball around a chunk may be seen.
fn may_show(node: &Node, camera: &Camera) -> bool {
    let centre = camera.to_view((0.5 * (node.low + node.high)).as_dvec3());
    let radius = f64::from(0.5 * node.low.distance(node.high) + node.reach);
    let size = DVec3::new(f64::from(camera.width), f64::from(camera.height), 0.0);
    let inside = |focal: f64, principal: f64, side: f64, along: f64| {
        // Planes through the eye and the borders of the image.
        let [near, far] = [(-MARGIN * side - principal) / focal, ((1.0 + MARGIN) * side - principal) / focal];
        let distance = |slope: f64, sign: f64| sign * (along - slope * centre.z) / slope.hypot(1.0);
        distance(near, 1.0) > -radius && distance(far, -1.0) > -radius
    };
    centre.z > -radius
        && inside(camera.focal.x, camera.principal.x, size.x, centre.x)
        && inside(camera.focal.y, camera.principal.y, size.y, centre.y)
}

/// The chunks of a view, at most `most`: together they stand for all leaves, each once. The ones with the largest error are
/// replaced by their children until none is above `pixels`.
pub fn cut(nodes: &[Node], camera: &Camera, most: usize, pixels: f64) -> Vec<u32> {
    let mut queue = BinaryHeap::new();
    let candidate = |node: u32| Candidate { error: error_in(&nodes[node as usize], camera), node };
    queue.push(candidate(0));
    let mut done = Vec::new();
    while let Some(Candidate { error, node }) = queue.pop() {
        match nodes[node as usize].children {
            Some(children) if error > pixels && done.len() + queue.len() + 2 <= most => {
                queue.extend(children.map(candidate));
            }
            _ => done.push(node),
        }
    }
    done
}

impl Node {
    /// A chunk of nothing, to be widened.
    pub(super) fn empty() -> Self {
        Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY, reach: 0.0, error: 0.0, count: 0, children: None }
    }
}

#[cfg(test)]
mod tests {
    use super::super::build::{build, tests::cloud};
    use super::*;
    use glam::{DMat3, DVec2};

    /// At a place, looking along z.
    fn camera(x: f64, y: f64, z: f64) -> Camera {
        Camera {
            width: 200,
            height: 100,
            focal: DVec2::splat(100.0),
            principal: DVec2::new(100.0, 50.0),
            view_from_world: DMat3::IDENTITY,
            translation: -DVec3::new(x, y, z),
        }
    }

    fn leaves_below(nodes: &[Node], node: u32) -> Vec<u32> {
        match nodes[node as usize].children {
            None => vec![node],
            Some(children) => children.into_iter().flat_map(|child| leaves_below(nodes, child)).collect(),
        }
    }

    #[test]
    fn a_cut_stands_for_every_leaf_once_and_keeps_to_its_number() {
        let nodes: Vec<Node> = build(cloud(3_000), 64).into_iter().map(|(node, _)| node).collect();
        let mut all = leaves_below(&nodes, 0);
        all.sort_unstable();
        for most in [1, 2, 7, 20, 1_000] {
            for pixels in [0.0, 0.5, 20.0] {
                let cut = cut(&nodes, &camera(0.0, 0.0, -6.0), most, pixels);
                assert!(cut.len() <= most);
                let mut below: Vec<u32> = cut.iter().flat_map(|&node| leaves_below(&nodes, node)).collect();
                below.sort_unstable();
                assert_eq!(below, all, "{most} {pixels}");
            }
        }
        assert_eq!(cut(&nodes, &camera(0.0, 0.0, -6.0), 1_000, 0.0).len(), all.len(), "all of it is in the image");
        assert_eq!(cut(&nodes, &camera(0.0, 0.0, -1e6), 1_000, 0.5), [0], "far away one chunk will do");
    }

    #[test]
    fn what_is_near_is_fine_and_what_is_outside_coarse() {
        let nodes: Vec<Node> = build(cloud(3_000), 64).into_iter().map(|(node, _)| node).collect();
        let error = |node: u32, camera: &Camera| error_in(&nodes[node as usize], camera);
        let (before, behind) = (camera(0.0, 0.0, -6.0), camera(0.0, 0.0, 60.0));
        assert!(error(0, &before) > 0.0);
        assert_eq!(error(0, &behind), 0.0);
        assert_eq!(error(0, &camera(500.0, 0.0, -6.0)), 0.0);
        assert_eq!(error(0, &camera(0.0, -500.0, -6.0)), 0.0);
        assert!(error(0, &camera(0.0, 0.0, -60.0)) < 0.2 * error(0, &before));
        assert_eq!(cut(&nodes, &behind, 1_000, 0.0), [0]);
    }
}
