//! The first Gaussians, one per point of the initial cloud (method.md section 1).

use super::gaussians::{Gaussians, MAX_SH_DEGREE, SH_C0};
use super::{SceneError, gaussians};
use crate::dataset::Point;
use crate::local_space::LocalSpace;
use kiddo::{KdTree, SquaredEuclidean};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::collections::HashMap;

/// Neighbours whose distances set the first scale.
const NEIGHBOURS: usize = 3;

/// Least mean squared distance to the neighbours, in squared local units.
const MIN_SQUARED_DISTANCE: f64 = 1e-7;

/// One isotropic Gaussian per point: scale = square root of the mean squared distance to the 3 nearest other points
/// (at least 1e-7 before the root), identity rotation, SH dc from the colour, other coefficients 0, normal (0, 0, 1),
/// offset 0. With fewer than 4 points the mean runs over the others there are. `opacity` is the value after the
/// sigmoid (method.md section 1: 0.1). The points are in local coordinates, see [`Point::to_local`].
///
/// # Errors
/// [`SceneError::BadPoint`] for a position that is not finite as a 32-bit float, [`SceneError::ShDegree`],
/// [`SceneError::BadOpacity`].
pub fn from_points(points: &[Point], sh_degree: u32, opacity: f64) -> Result<Gaussians, SceneError> {
    if sh_degree > MAX_SH_DEGREE {
        return Err(SceneError::ShDegree { degree: sh_degree });
    }
    if !(opacity > 0.0 && opacity < 1.0) {
        return Err(SceneError::BadOpacity { opacity });
    }
    let bad = |p: &Point| !p.position.as_vec3().is_finite();
    if let Some(index) = points.iter().position(bad) {
        return Err(SceneError::BadPoint { index, position: points[index].position.to_array() });
    }
    let n = points.len();
    let row = 3 * gaussians::coefficients(sh_degree);
    let mut sh = vec![0.0; n * row];
    for (coefficients, point) in sh.chunks_exact_mut(row).zip(points) {
        for (dc, byte) in coefficients.iter_mut().zip(point.color) {
            *dc = ((f64::from(byte) / 255.0 - 0.5) / SH_C0) as f32;
        }
    }
    let log_scale = |squared: f64| (0.5 * squared.max(MIN_SQUARED_DISTANCE).ln()) as f32;
    Ok(Gaussians {
        space: LocalSpace::default(),
        means: points.iter().map(|p| p.position.as_vec3().to_array()).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
        log_scales: mean_squared_distances(points).into_iter().map(|squared| [log_scale(squared); 3]).collect(),
        opacity_logits: vec![(opacity / (1.0 - opacity)).ln() as f32; n],
        sh,
        sh_degree,
        normals: vec![[0.0, 0.0, 1.0]; n],
        offsets: vec![0.0; n],
        antialiased: false,
    })
}

/// Mean squared distance of each point to its nearest other points, up to [`NEIGHBOURS`] of them; 0 for a lone point.
///
/// The tree holds each position once, with its multiplicity beside it: its leaves are of fixed size and cannot split
/// a heap of equal points. Positions go in in a random order, the same each time: a file in which they follow one another
/// would make a tree as deep as a list.
fn mean_squared_distances(points: &[Point]) -> Vec<f64> {
    let mut index_of: HashMap<[u64; 3], usize> = HashMap::with_capacity(points.len());
    let mut copies: Vec<usize> = Vec::new();
    let mut positions: Vec<([f64; 3], u64)> = Vec::new();
    for point in points {
        // Adding 0 turns -0 into +0, so that equal positions have equal bits.
        let position = point.position.to_array().map(|v| v + 0.0);
        let index = *index_of.entry(position.map(f64::to_bits)).or_insert_with(|| {
            positions.push((position, copies.len() as u64));
            copies.push(0);
            copies.len() - 1
        });
        copies[index] += 1;
    }
    positions.shuffle(&mut ChaCha8Rng::seed_from_u64(0));
    let mut tree: KdTree<f64, 3> = KdTree::new();
    positions.iter().for_each(|(position, index)| tree.add(position, *index));
    points
        .par_iter()
        .map(|point| {
            let position = point.position.to_array().map(|v| v + 0.0);
            let near = tree.nearest_n::<SquaredEuclidean>(&position, NEIGHBOURS + 1);
            let squared = near
                .iter()
                .flat_map(|neighbour| std::iter::repeat_n(neighbour.distance, copies[neighbour.item as usize]));
            // The nearest entry is the point itself.
            let (sum, count) =
                squared.skip(1).take(NEIGHBOURS).fold((0.0, 0.0), |(sum, count), d| (sum + d, count + 1.0));
            if count > 0.0 { sum / count } else { 0.0 }
        })
        .collect()
}
