//! The tree of a model: halves at the median of the longest side, down to chunks; then, from the leaves up, two chunks to one.

use super::Node;
use crate::scene::Gaussians;
use glam::{DMat3, DQuat, DVec3, Vec3};
use rayon::prelude::*;

/// Most Gaussians of a chunk.
pub const CHUNK: usize = 16_384;
/// Neighbours that may become one.
const GROUP: usize = 4;
/// Opacity of a merged Gaussian at most.
const MOST_OPACITY: f64 = 0.99;
/// Factor by which a merged Gaussian that would have to be more opaque becomes wider at most: a sheet of such Gaussians then
/// lets a tenth of the light through, instead of six tenths.
const MOST_WIDENING: f64 = 2.0;
/// Scales are no larger than that of this logarithm, so that their squares fit.
const MOST_LOG_SCALE: f32 = 40.0;
/// Sweeps of Jacobi's method, which converges quadratically.
const SWEEPS: usize = 12;

/// A chunk and what it stands for.
struct Branch {
    node: Node,
    gaussians: Gaussians,
    children: Option<Box<[Branch; 2]>>,
}

/// The tree of a model with at least one Gaussian, chunks of at most `chunk`: its nodes and their Gaussians, the root first,
/// parents before children.
pub fn build(mut model: Gaussians, chunk: usize) -> Vec<(Node, Gaussians)> {
    if model.lacks_planes() {
        // Depths mean something then.
        model.normals = model.rotations.iter().zip(&model.log_scales).map(shortest_axis).collect();
    }
    let mut indices: Vec<u32> = (0..model.len() as u32).collect();
    let root = branch(&model, &mut indices, chunk.max(GROUP));
    drop(model);
    let mut nodes: Vec<(Node, Gaussians)> = Vec::new();
    // Level by level; each entry knows whose child it is.
    let mut level = vec![(root, None::<(usize, usize)>)];
    while !level.is_empty() {
        let mut next = Vec::new();
        for (Branch { node, gaussians, children }, parent) in level {
            let own = nodes.len();
            if let Some((parent, side)) = parent {
                nodes[parent].0.children.get_or_insert_default()[side] = own as u32;
            }
            nodes.push((node, gaussians));
            next.extend(
                children.into_iter().flat_map(|pair| *pair).zip(0..).map(|(child, side)| (child, Some((own, side)))),
            );
        }
        level = next;
    }
    nodes
}

fn branch(model: &Gaussians, indices: &mut [u32], chunk: usize) -> Branch {
    if indices.len() <= chunk {
        let gaussians = rows(model, indices);
        return Branch { node: bounds(&gaussians), gaussians, children: None };
    }
    let (left, right) = halves(model, indices);
    let (left, right) = rayon::join(|| branch(model, left, chunk), || branch(model, right, chunk));
    let mut both = left.gaussians.clone();
    both.append(right.gaussians.clone());
    let (gaussians, error) = coarser(&both, both.len().div_ceil(2));
    let mut node = bounds(&gaussians);
    // Nothing that it stands for lies outside.
    (node.low, node.high) = (left.node.low.min(right.node.low), left.node.high.max(right.node.high));
    node.reach = node.reach.max(left.node.reach).max(right.node.reach);
    node.error = error.max(left.node.error).max(right.node.error);
    Branch { node, gaussians, children: Some(Box::new([left, right])) }
}

/// Two parts of equal number, divided across the longest side of their box.
fn halves<'a>(model: &Gaussians, indices: &'a mut [u32]) -> (&'a mut [u32], &'a mut [u32]) {
    let mean = |&i: &u32| Vec3::from(model.means[i as usize]);
    let low = indices.iter().map(mean).fold(Vec3::INFINITY, Vec3::min);
    let high = indices.iter().map(mean).fold(Vec3::NEG_INFINITY, Vec3::max);
    let axis = (high - low).max_position();
    let middle = indices.len() / 2;
    let place = |i: u32| model.means[i as usize][axis];
    // By number where places are equal, so that the tree is the same every time.
    indices.select_nth_unstable_by(middle, |&a, &b| place(a).total_cmp(&place(b)).then(a.cmp(&b)));
    indices.split_at_mut(middle)
}

fn bounds(gaussians: &Gaussians) -> Node {
    let mut node = Node { count: gaussians.len() as u32, ..Node::empty() };
    for (mean, scales) in gaussians.means.iter().zip(&gaussians.log_scales) {
        (node.low, node.high) = (node.low.min(Vec3::from(*mean)), node.high.max(Vec3::from(*mean)));
        node.reach = scales.iter().fold(node.reach, |reach, scale| reach.max(3.0 * scale.min(MOST_LOG_SCALE).exp()));
    }
    node
}

/// Some of a model's Gaussians.
fn rows(model: &Gaussians, indices: &[u32]) -> Gaussians {
    model.rows(indices.len(), indices.iter().map(|&i| i as usize))
}

/// About `wanted` Gaussians in place of all: of groups of neighbours those become one that are smallest then. Also the largest
/// standard deviation among the merged.
fn coarser(all: &Gaussians, wanted: usize) -> (Gaussians, f32) {
    let mut indices: Vec<u32> = (0..all.len() as u32).collect();
    let mut groups: Vec<&[u32]> = Vec::new();
    let mut open = vec![&mut indices[..]];
    while let Some(part) = open.pop() {
        if part.len() <= GROUP {
            groups.push(part);
        } else {
            let (left, right) = halves(all, part);
            open.extend([left, right]);
        }
    }
    let mut merged: Vec<(f64, Merged, &[u32])> = groups
        .into_par_iter()
        .map(|group| {
            let one = Merged::of(all, group);
            (one.scales.max_element(), one, group)
        })
        .collect();
    merged.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(b.2)));
    let (mut left, mut joined) = (all.len(), 0);
    while left > wanted && joined < merged.len() {
        left -= merged[joined].2.len() - 1;
        joined += 1;
    }
    let (joined, kept) = merged.split_at(joined);
    let mut result = Gaussians { space: all.space, ..Gaussians::with_capacity(left, all.sh_degree) };
    joined.iter().for_each(|(_, one, group)| one.push(all, group, &mut result));
    let kept: Vec<u32> = kept.iter().flat_map(|(_, _, group)| *group).copied().collect();
    result.append(rows(all, &kept));
    let several = joined.iter().filter(|(_, _, group)| group.len() > 1);
    (result, several.fold(0.0, |error, (size, ..)| error.max(*size as f32)))
}

/// One Gaussian with the mass, the centre and the second moments of several.
struct Merged {
    mean: DVec3,
    rotation: DQuat,
    scales: DVec3,
    opacity: f64,
    /// Each one's part of the mass, which is opacity times the mean area that it shows.
    weights: Vec<f64>,
}

/// The rotation of a Gaussian; none where its quaternion is zero, which the rasterizer does not show.
pub(super) fn axes_of([w, x, y, z]: [f32; 4]) -> DMat3 {
    let quaternion = DQuat::from_xyzw(x.into(), y.into(), z.into(), w.into());
    DMat3::from_quat(if quaternion.length_squared() > 0.0 { quaternion.normalize() } else { DQuat::IDENTITY })
}

/// Direction of the smallest scale (method.md section 1).
fn shortest_axis((rotation, scales): (&[f32; 4], &[f32; 3])) -> [f32; 3] {
    axes_of(*rotation).col(Vec3::from(*scales).min_position()).as_vec3().to_array()
}

/// Mean area that an ellipsoid with these half axes shows, up to a factor.
fn area(s: DVec3) -> f64 {
    s.x * s.y + s.y * s.z + s.z * s.x
}

pub(super) fn scales_of(all: &Gaussians, i: u32) -> DVec3 {
    Vec3::from(all.log_scales[i as usize]).min(Vec3::splat(MOST_LOG_SCALE)).as_dvec3().exp()
}

impl Merged {
    fn of(all: &Gaussians, group: &[u32]) -> Self {
        let mass = |&i: &u32| area(scales_of(all, i)) / (1.0 + (-f64::from(all.opacity_logits[i as usize])).exp());
        let masses: Vec<f64> = group.iter().map(mass).collect();
        let total: f64 = masses.iter().sum();
        // Where nothing is seen all count alike.
        let part = |mass: f64| if total > 0.0 { mass / total } else { (group.len() as f64).recip() };
        let weights: Vec<f64> = masses.into_iter().map(part).collect();
        let means: Vec<DVec3> = group.iter().map(|&i| Vec3::from(all.means[i as usize]).as_dvec3()).collect();
        let mean = means.iter().zip(&weights).map(|(mean, weight)| *weight * *mean).sum();
        let mut covariance = DMat3::ZERO;
        for ((&i, place), weight) in group.iter().zip(means).zip(&weights) {
            let axes = axes_of(all.rotations[i as usize]);
            let squares = DMat3::from_diagonal(scales_of(all, i).powf(2.0));
            let step: DVec3 = place - mean;
            let apart = DMat3::from_cols(step * step.x, step * step.y, step * step.z);
            covariance += *weight * (axes * squares * axes.transpose() + apart);
        }
        let (values, axes) = principal_axes(covariance);
        let scales = values.max(DVec3::splat(1e-18)).powf(0.5);
        // Several layers that become one must not leave holes between it and its neighbours.
        let scales = scales * (total / (MOST_OPACITY * area(scales))).sqrt().clamp(1.0, MOST_WIDENING);
        let opacity = (total / area(scales)).min(MOST_OPACITY);
        Self { mean, rotation: DQuat::from_mat3(&axes).normalize(), scales, opacity, weights }
    }

    /// Adds it to the Gaussians; one alone stays as it is.
    fn push(&self, all: &Gaussians, group: &[u32], to: &mut Gaussians) {
        if group.len() == 1 {
            return to.append(rows(all, group));
        }
        let width = 3 * all.sh_coefficients();
        let sums = (0..width).map(|k| {
            let each = group.iter().zip(&self.weights);
            each.map(|(&i, weight)| weight * f64::from(all.sh[width * i as usize + k])).sum::<f64>() as f32
        });
        to.sh.extend(sums);
        to.means.push(self.mean.as_vec3().to_array());
        let DQuat { x, y, z, w } = self.rotation;
        to.rotations.push([w, x, y, z].map(|v| v as f32));
        to.log_scales.push(self.scales.ln().as_vec3().to_array());
        let opacity = self.opacity.max(1e-9);
        to.opacity_logits.push((opacity / (1.0 - opacity)).ln() as f32);
        // The plane through the mean point of the planes, across their mean normal.
        let normal_of = |i: u32| Vec3::from(all.normals[i as usize]).as_dvec3().normalize_or_zero();
        let first = normal_of(group[0]);
        let (mut normal, mut point) = (DVec3::ZERO, DVec3::ZERO);
        for (&i, &weight) in group.iter().zip(&self.weights) {
            let own = normal_of(i);
            normal += weight * own * if own.dot(first) < 0.0 { -1.0 } else { 1.0 };
            point += weight * (Vec3::from(all.means[i as usize]).as_dvec3() + f64::from(all.offsets[i as usize]) * own);
        }
        let normal = normal.try_normalize().unwrap_or(first);
        to.normals.push(normal.as_vec3().to_array());
        to.offsets.push((point - self.mean).dot(normal) as f32);
    }
}

/// Eigenvalues and eigenvectors of a symmetric matrix, by Jacobi's method; the vectors are a rotation.
fn principal_axes(symmetric: DMat3) -> (DVec3, DMat3) {
    let (mut a, mut axes) = (symmetric, DMat3::IDENTITY);
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = a.col(q)[p];
            if off == 0.0 {
                continue;
            }
            let theta = (a.col(q)[q] - a.col(p)[p]) / (2.0 * off);
            let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
            let c = t.hypot(1.0).recip();
            let s = t * c;
            let mut turn = DMat3::IDENTITY;
            (turn.col_mut(p)[p], turn.col_mut(q)[q]) = (c, c);
            (turn.col_mut(q)[p], turn.col_mut(p)[q]) = (s, -s);
            a = turn.transpose() * a * turn;
            axes *= turn;
        }
    }
    (DVec3::new(a.x_axis.x, a.y_axis.y, a.z_axis.z), axes)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// A cloud of `n` Gaussians of degree 1, ten units wide.
    pub fn cloud(n: usize) -> Gaussians {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut g = Gaussians::with_capacity(n, 1);
        for i in 0..n {
            g.means.push(std::array::from_fn(|_| rng.random_range(-5.0..5.0)));
            g.rotations.push(std::array::from_fn(|_| rng.random_range(-1.0f32..1.0)));
            g.log_scales.push(std::array::from_fn(|_| rng.random_range(-4.0..-1.0)));
            g.opacity_logits.push(rng.random_range(-3.0..3.0));
            g.sh.extend((0..12).map(|_| rng.random_range(-1.0f32..1.0)));
            g.normals.push(std::array::from_fn(|_| rng.random_range(-1.0f32..1.0)));
            // Each is known by it.
            g.offsets.push(i as f32);
        }
        g
    }

    #[test]
    fn the_leaves_hold_every_gaussian_once_and_levels_become_coarser() {
        let model = cloud(3_000);
        let nodes = build(model.clone(), 128);
        let mut found: Vec<f32> = Vec::new();
        for (node, gaussians) in &nodes {
            gaussians.validate().unwrap();
            assert!(gaussians.len() == node.count as usize && node.count <= 128, "{}", node.count);
            let inside = |mean: &[f32; 3]| {
                Vec3::from(*mean).cmpge(node.low - 1e-4).all() && Vec3::from(*mean).cmple(node.high + 1e-4).all()
            };
            assert!(gaussians.means.iter().all(inside));
            match node.children {
                None => {
                    assert_eq!(node.error, 0.0);
                    found.extend(&gaussians.offsets);
                }
                Some(children) => {
                    let [left, right] = children.map(|child| &nodes[child as usize].0);
                    assert!(node.error >= left.error.max(right.error) && node.error > 0.0);
                    let both = (left.count + right.count) as usize;
                    assert!((both / 2 - 3..=both / 2 + 1).contains(&gaussians.len()), "{} of {both}", gaussians.len());
                }
            }
        }
        found.sort_by(f32::total_cmp);
        assert_eq!(found, (0..3_000).map(|i| i as f32).collect::<Vec<_>>());
        assert_eq!(build(model, 128), nodes, "the same every time");
    }

    /// Mass, centre and second moments stay; what lies on one plane stays on it.
    #[test]
    fn a_merged_gaussian_has_the_moments_of_its_parts() {
        let mut all = cloud(4);
        all.normals = vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]];
        all.offsets =
            all.means.iter().zip([1.0f32, -1.0, 1.0, 1.0]).map(|(mean, sign)| sign * (2.0 - mean[2])).collect();
        all.opacity_logits = vec![-4.0; 4];
        let group = [0, 1, 2, 3];
        let merged = Merged::of(&all, &group);
        let mass = |i: u32| area(scales_of(&all, i)) / (1.0 + 4f64.exp());
        let total: f64 = group.iter().map(|&i| mass(i)).sum();
        assert!((merged.opacity * area(merged.scales) / total - 1.0).abs() < 1e-9);
        let axes = DMat3::from_quat(merged.rotation);
        let covariance = axes * DMat3::from_diagonal(merged.scales.powf(2.0)) * axes.transpose();
        let mut expected = DMat3::ZERO;
        for &i in &group {
            let [w, x, y, z] = all.rotations[i as usize].map(f64::from);
            let own = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
            let step = Vec3::from(all.means[i as usize]).as_dvec3() - merged.mean;
            let squares = DMat3::from_diagonal(scales_of(&all, i).powf(2.0));
            let apart = DMat3::from_cols(step * step.x, step * step.y, step * step.z);
            expected += mass(i) / total * (own * squares * own.transpose() + apart);
        }
        assert!(covariance.abs_diff_eq(expected, 1e-9), "{covariance} {expected}");
        let mut one = Gaussians::with_capacity(1, 1);
        merged.push(&all, &group, &mut one);
        let plane = one.means[0][2] + one.normals[0][2] * one.offsets[0];
        assert!((plane - 2.0).abs() < 1e-4 && one.normals[0][2].abs() > 0.999, "{one:?}");
        assert_eq!(one.validate().ok(), Some(()));
        // Equal ones in one place stay what they are, only denser.
        let twins = rows(&all, &[2, 2, 2, 2]);
        let same = Merged::of(&twins, &group);
        let [mut scales, mut own] = [same.scales, scales_of(&all, 2)].map(|scales| scales.to_array());
        scales.sort_by(f64::total_cmp);
        own.sort_by(f64::total_cmp);
        assert!(scales.iter().zip(own).all(|(a, b)| (a / b - 1.0).abs() < 1e-6), "{scales:?} {own:?}");
    }

    /// What no rasterizer shows, or nobody wants, spoils no other chunk.
    #[test]
    fn every_chunk_of_odd_gaussians_is_finite() {
        let mut model = cloud(600);
        model.rotations[..300].fill([0.0; 4]);
        model.log_scales[100] = [200.0, 88.7, -200.0];
        model.log_scales[200] = [-200.0; 3];
        model.opacity_logits[300..400].fill(-500.0);
        model.normals.fill([0.0, 0.0, 1.0]);
        model.rotations[599] = [1.0, 0.0, 0.0, 0.0];
        model.log_scales[599] = [-1.0, -3.0, -2.0];
        let nodes = build(model, 32);
        for (node, gaussians) in &nodes {
            gaussians.validate().unwrap();
            assert!(node.error.is_finite() && node.reach.is_finite(), "{node:?}");
        }
        let last = nodes.iter().find_map(|(node, g)| {
            let at = g.offsets.iter().position(|&offset| offset == 599.0).filter(|_| node.children.is_none())?;
            Some(g.normals[at])
        });
        assert_eq!(last, Some([0.0, 1.0, 0.0]), "the shortest axis");
    }

    #[test]
    fn small_neighbours_are_merged_first() {
        let mut all = cloud(64);
        all.log_scales = vec![[-5.0; 3]; 64];
        // The first half lies close together, the second far apart.
        for (i, mean) in all.means.iter_mut().enumerate() {
            let at = i as f32;
            *mean = if i < 32 { [0.01 * at, 0.0, 0.0] } else { [10.0 * at, 0.0, 0.0] };
        }
        let (fewer, error) = coarser(&all, 40);
        assert_eq!(fewer.len(), 40);
        assert!(error < 0.1, "{error}");
        let kept = fewer.means.iter().filter(|mean| mean[0] >= 320.0).count();
        assert_eq!(kept, 32);
    }
}
