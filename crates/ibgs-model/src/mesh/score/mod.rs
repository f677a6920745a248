//! How near a mesh is to the true surface: precision, recall and F1 as the Tanks & Temples protocol defines them, accuracy,
//! completeness and Chamfer distance as DTU's does.
//!
//! Tanks & Temples: the reconstruction is brought to the truth by a given matrix, both are cropped, thinned to the mean of the
//! points in each voxel of half the threshold, and precision (recall) is the part of the reconstruction (truth) that has a point
//! of the other nearer than the threshold. The refinement of the matrix by ICP is left out: it is taken as it is.
//!
//! DTU: both are thinned so that no two points are nearer than the density (in random order), and accuracy (completeness) is
//! the mean distance of the reconstruction (truth) to the other, without distances over the largest one. The observation masks
//! are left out; a crop volume can take their place.

mod cloud;
mod crop;
mod files;

pub use cloud::Cloud;
pub use crop::CropVolume;
pub use files::{read_transform, read_truth};

use super::MeshError;
use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use serde::Serialize;

/// Part of both surfaces near the other one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FScore {
    /// Distance that still counts as near.
    pub threshold: f64,
    /// Part of the reconstruction that is near the truth.
    pub precision: f64,
    /// Part of the truth that is near the reconstruction.
    pub recall: f64,
    /// Harmonic mean of both; 0 where both are.
    pub f1: f64,
}

/// Mean distances between both surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Chamfer {
    /// Least distance between two points of one cloud.
    pub density: f64,
    /// Larger distances are left out.
    pub max_distance: f64,
    /// Mean distance of the reconstruction to the truth; none where no distance is left.
    pub accuracy: Option<f64>,
    /// Mean distance of the truth to the reconstruction; none where no distance is left.
    pub completeness: Option<f64>,
    /// Mean of both.
    pub chamfer: Option<f64>,
}

/// What is compared. All points are in the truth's coordinates, and cropped.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    /// Points of the reconstruction.
    pub mesh: &'a Cloud,
    /// Points of the true surface.
    pub truth: &'a Cloud,
    /// Points of the true surface that a reconstruction should have: all, or those that a camera sees.
    pub wanted: &'a Cloud,
}

impl Pair<'_> {
    fn check(&self, place: &'static str) -> Result<(), MeshError> {
        for (which, cloud) in
            [("the mesh", self.mesh), ("the true surface", self.truth), ("the true surface", self.wanted)]
        {
            if cloud.points.is_empty() {
                return Err(MeshError::NoPoints { which, place });
            }
        }
        Ok(())
    }

    /// Precision, recall and F1 at a threshold.
    ///
    /// # Errors
    /// [`MeshError::NoPoints`] where one of the clouds is empty.
    pub fn f_score(&self, threshold: f64) -> Result<FScore, MeshError> {
        self.check("within the crop volume")?;
        let [mesh, truth, wanted] =
            [self.mesh, self.truth, self.wanted].map(|cloud| cloud.averaged(0.5 * threshold).points);
        let near = |from: &[DVec3], to: &[DVec3]| {
            let count = Nearest::new(to).distances(from).into_iter().filter(|&d| d < threshold).count();
            count as f64 / from.len() as f64
        };
        let (precision, recall) = (near(&mesh, &truth), near(&wanted, &mesh));
        let sum = precision + recall;
        let f1 = if sum > 0.0 { 2.0 * precision * recall / sum } else { 0.0 };
        Ok(FScore { threshold, precision, recall, f1 })
    }

    /// Mean angle in degrees between the normals of the reconstruction and those of the nearest true points, where these are
    /// nearer than the threshold; none where no normals are known or nothing is near.
    ///
    /// # Errors
    /// [`MeshError::NoPoints`] where one of the clouds is empty.
    pub fn normal_error(&self, threshold: f64) -> Result<Option<f64>, MeshError> {
        self.check("within the crop volume")?;
        let [mesh, truth] = [self.mesh, self.truth].map(|cloud| cloud.averaged(0.5 * threshold));
        if mesh.normals.is_empty() || truth.normals.is_empty() {
            return Ok(None);
        }
        let tree = Nearest::new(&truth.points);
        let angle = |i: usize| {
            let (distance, nearest) = tree.of(mesh.points[i]);
            (distance < threshold).then(|| mesh.normals[i].angle_between(truth.normals[nearest]).to_degrees())
        };
        let angles: Vec<f64> =
            (0..mesh.points.len()).into_par_iter().filter_map(angle).filter(|a| a.is_finite()).collect();
        Ok((!angles.is_empty()).then(|| angles.iter().sum::<f64>() / angles.len() as f64))
    }

    /// Accuracy, completeness and Chamfer distance.
    ///
    /// # Errors
    /// [`MeshError::NoPoints`] where one of the clouds is empty.
    pub fn chamfer(&self, density: f64, max_distance: f64) -> Result<Chamfer, MeshError> {
        self.check("within the crop volume")?;
        let [mesh, truth, wanted] = [self.mesh, self.truth, self.wanted].map(|cloud| cloud.spread(density).points);
        let mean = |from: &[DVec3], to: &[DVec3]| {
            let all = Nearest::new(to).distances(from).into_iter().filter(|&d| d < max_distance);
            let (sum, count) = all.fold((0.0, 0_usize), |(sum, count), d| (sum + d, count + 1));
            (count > 0).then(|| sum / count as f64)
        };
        let (accuracy, completeness) = (mean(&mesh, &truth), mean(&wanted, &mesh));
        let chamfer = accuracy.zip(completeness).map(|(a, b)| (a + b) / 2.0);
        Ok(Chamfer { density, max_distance, accuracy, completeness, chamfer })
    }
}

/// Finds nearest points.
pub(super) struct Nearest(ImmutableKdTree<f64, 3>);

impl Nearest {
    /// Of at least one point.
    pub(super) fn new(points: &[DVec3]) -> Self {
        let points: Vec<[f64; 3]> = points.iter().map(DVec3::to_array).collect();
        Self(ImmutableKdTree::new_from_slice(&points))
    }

    /// Distance to the nearest point and its index.
    pub(super) fn of(&self, point: DVec3) -> (f64, usize) {
        let found = self.0.nearest_one::<SquaredEuclidean>(&point.to_array());
        (found.distance.sqrt(), found.item as usize)
    }

    fn distances(&self, points: &[DVec3]) -> Vec<f64> {
        points.par_iter().map(|&point| self.of(point).0).collect()
    }
}

#[cfg(test)]
mod tests;
