//! Points from the rays that see them.

use super::Seen;
use super::reprojection::error;
use crate::camera::Camera;
use glam::{DMat3, DVec3};

/// Sine of the least angle between a ray and the mean of all, so that depth is known.
const LEAST_ANGLE: f64 = 0.01;
/// Rounds of weighing down the rays that miss the point.
const ROUNDS: usize = 5;
/// Errors up to as many times the scale count as seen.
pub(super) const INLIER: f64 = 4.0;

/// The point of a track, nearest to its rays, those that miss it by more than `scale` pixels counting less; none where the rays are
/// nearly parallel or fewer than two agree.
pub(super) fn triangulate(cameras: &[Camera], track: &[Seen], scale: f64) -> Option<DVec3> {
    let rays: Vec<(DVec3, DVec3)> =
        track.iter().map(|seen| (cameras[seen.view].center(), cameras[seen.view].ray(seen.pixel))).collect();
    let mean = rays.iter().map(|(_, ray)| *ray).sum::<DVec3>().normalize_or_zero();
    if rays.iter().all(|(_, ray)| ray.cross(mean).length() < LEAST_ANGLE) {
        return None;
    }
    let mut weights = vec![1.0; track.len()];
    let mut point = DVec3::ZERO;
    for _ in 0..ROUNDS {
        let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for ((center, ray), weight) in rays.iter().zip(&weights) {
            let across = DMat3::IDENTITY - DMat3::from_cols(*ray * ray.x, *ray * ray.y, *ray * ray.z);
            matrix += across * *weight;
            right += across * *center * *weight;
        }
        point = matrix.inverse() * right;
        if !point.is_finite() {
            return None;
        }
        for (weight, seen) in weights.iter_mut().zip(track) {
            let camera = &cameras[seen.view];
            // Rays count by the pixels that they miss by, so by focal length and depth.
            let (depth, error) = (camera.to_view(point).z, error(camera, point, seen.pixel));
            *weight =
                error.map_or(1e-9, |e| (camera.focal.x / depth).powi(2) / (1.0 + e.length_squared() / (scale * scale)));
        }
        let most = weights.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        weights.iter_mut().for_each(|weight| *weight /= most);
    }
    is_seen(cameras, track, point, scale).then_some(point)
}

/// Whether at least two views have the point where they show it.
pub(super) fn is_seen(cameras: &[Camera], track: &[Seen], point: DVec3, scale: f64) -> bool {
    let near =
        |seen: &&Seen| error(&cameras[seen.view], point, seen.pixel).is_some_and(|e| e.length() < INLIER * scale);
    track.iter().filter(near).count() >= 2
}
