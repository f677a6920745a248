//! Placing a model: its size by a known length, its ground and up axis by three points.

use crate::model::Model;
use crate::residual::weights::turned;
use crate::similarity::Similarity;
use crate::sources::find::{Distances, PUBLISHED_DISTANCES};
use glam::{DMat3, DQuat, DVec3};

/// Up in files: the axes of 3DGS are x to the right, y down, z forward.
pub const UP: DVec3 = DVec3::NEG_Y;
/// Least sine of the angle at the first of three points.
const LEAST_SINE: f64 = 1e-3;

impl Model {
    /// Moves, turns and scales its Gaussians and cameras, and turns what its networks read in the scene's axes: its images stay
    /// what they are, but for rounding. The identity changes nothing, to the last digit.
    pub fn place(&mut self, by: &Similarity) {
        if *by == Similarity::IDENTITY {
            return;
        }
        // The median of turned positions is another one, so lengths would be measured by another extent.
        self.config.data.extent = Some(by.scale * self.space().extent());
        let members = self.members.iter_mut().map(|member| (&mut member.gaussians, &mut member.network));
        for (gaussians, network) in std::iter::once((&mut self.gaussians, &mut self.network)).chain(members) {
            *gaussians = std::mem::take(gaussians).moved(by);
            *network = network.take().map(|weights| turned(&weights, by.rotation));
        }
        let sources = &mut self.config.sources;
        if sources.distances == Distances::Absolute {
            let usual = [&mut sources.min_distance, &mut sources.max_distance].into_iter().zip(PUBLISHED_DISTANCES);
            usual.for_each(|(distance, usual)| *distance = Some(distance.unwrap_or(usual)));
        }
        for distance in [&mut sources.min_distance, &mut sources.max_distance] {
            *distance = distance.map(|distance| by.scale * distance);
        }
        for record in &mut self.cameras {
            record.camera = by.camera(&record.camera);
        }
    }
}

/// A placement in which a distance between two points of the scene has a length. None where they are one, or the length is not
/// positive.
pub fn scaled(placement: &Similarity, [from, to]: [DVec3; 2], length: f64) -> Option<Similarity> {
    let factor = length / (placement.scale * from.distance(to));
    (factor > 0.0 && factor.is_finite()).then(|| placement.then(&Similarity { scale: factor, ..Similarity::IDENTITY }))
}

/// A placement in which three points of the scene lie on the ground, where y is 0, with `eye` above them. None where they are on
/// a line.
pub fn upright(placement: &Similarity, points: [DVec3; 3], eye: DVec3) -> Option<Similarity> {
    let [a, b, c] = points.map(|point| placement.point(point));
    let (along, across) = (b - a, c - a);
    let normal = along.cross(across);
    let is_plane = normal.length() > LEAST_SINE * along.length() * across.length();
    if !is_plane {
        return None;
    }
    let normal = normal.normalize();
    let up = if (placement.point(eye) - a).dot(normal) < 0.0 { -normal } else { normal };
    let rotation = DMat3::from_quat(DQuat::from_rotation_arc(up, UP));
    let height = (rotation * a).dot(UP);
    Some(placement.then(&Similarity { scale: 1.0, rotation, translation: -height * UP }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn placement() -> Similarity {
        Similarity { scale: 2.0, rotation: DMat3::from_rotation_x(0.7), translation: DVec3::new(1.0, 2.0, 3.0) }
    }

    #[test]
    fn a_known_length_sets_the_scale() {
        let ends = [DVec3::new(1.0, 0.0, 0.0), DVec3::new(1.0, 3.0, 4.0)];
        for before in [Similarity::IDENTITY, placement()] {
            let after = scaled(&before, ends, 12.5).unwrap();
            let [from, to] = ends.map(|end| after.point(end));
            assert!((from.distance(to) - 12.5).abs() < 1e-12 && (after.scale - 2.5).abs() < 1e-12);
            assert_eq!(after.rotation, before.rotation);
            for length in [0.0, -1.0, f64::NAN, f64::INFINITY] {
                assert_eq!(scaled(&before, ends, length), None, "{length}");
            }
            assert_eq!(scaled(&before, [DVec3::ONE; 2], 1.0), None);
        }
    }

    #[test]
    fn three_points_become_the_ground() {
        let points = [DVec3::new(1.0, 0.0, 2.0), DVec3::new(3.0, 1.0, 2.0), DVec3::new(0.0, 2.0, 4.0)];
        let normal = (points[1] - points[0]).cross(points[2] - points[0]).normalize();
        for before in [Similarity::IDENTITY, placement()] {
            for side in [1.0, -1.0] {
                let eye = points[0] + side * 5.0 * normal;
                let after = upright(&before, points, eye).unwrap();
                assert!(points.iter().all(|&point| after.point(point).y.abs() < 1e-12));
                // Up is where the camera is: y points down.
                assert!((after.point(eye).y + 5.0 * before.scale).abs() < 1e-12);
                assert!((after.scale - before.scale).abs() < 1e-12);
                assert!((after.rotation.determinant() - 1.0).abs() < 1e-12);
            }
            let line = [DVec3::ZERO, DVec3::X, DVec3::X * 3.0];
            assert_eq!(upright(&before, line, DVec3::Z), None);
            assert_eq!(upright(&before, [DVec3::ONE; 3], DVec3::Z), None);
        }
    }
}
