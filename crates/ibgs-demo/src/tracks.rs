//! Which photos have the initial points: what structure from motion would find, with the noise of its features.

use super::cloud::Found;
use super::numeric::Stream;
use super::scene::Scene;
use super::shape::Ray;
use glam::{DVec2, DVec3};
use ibgs_data::adjust::{Seen, Track};
use ibgs_data::camera::Camera;
use rayon::prelude::*;

/// Standard deviation of an observation along each axis in pixels.
const NOISE: f64 = 0.3;
/// Most photos that have a point: that in which it was found and those next to it.
const LONGEST: usize = 10;
/// Points with a track for each photo, on average: of more every so many-th has one, as adjusting cameras takes no more.
const ENOUGH: usize = 400;
/// What a ray meets this much nearer than a point hides it, in metres.
const HIDING: f64 = 1e-4;
/// Observations are written in parts of a pixel.
const PARTS: f64 = 1000.0;

/// The tracks of points that several photos see, with the points' noisy places. Views have their numbers in `cameras`.
pub(super) fn tracks(scene: &Scene, cameras: &[Camera], points: &[Found], seed: u64) -> Vec<Track> {
    let centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
    let beside: Vec<Vec<usize>> = (0..cameras.len()).into_par_iter().map(|view| beside(&centers, view)).collect();
    let track = |(index, Found { point, surface }): (usize, &Found)| {
        let (view, place) = (*surface)?;
        let mut random = Stream::new(seed, 6, index as u64);
        let mut seen = |view: usize| {
            let pixel = observation(scene, &cameras[view], place, &mut random)?;
            Some(Seen { view, pixel })
        };
        let seen: Vec<Seen> = beside[view].iter().filter_map(|&view| seen(view)).collect();
        (seen.len() > 1).then_some(Track { position: Some(point.position), seen })
    };
    let step = points.len().div_ceil(ENOUGH * cameras.len().max(1)).max(1);
    points.par_iter().enumerate().step_by(step).filter_map(track).collect()
}

/// A view and those next to it, in the order of their numbers.
fn beside(centers: &[DVec3], view: usize) -> Vec<usize> {
    let mut near: Vec<(f64, usize)> =
        centers.iter().zip(0..).map(|(center, other)| (center.distance_squared(centers[view]), other)).collect();
    if near.len() > LONGEST {
        near.select_nth_unstable_by(LONGEST, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.truncate(LONGEST);
    }
    let mut near: Vec<usize> = near.into_iter().map(|(_, other)| other).collect();
    near.sort_unstable();
    near
}

/// Where a photo has a place of a surface, as its features would say; none where the place is hidden or outside.
fn observation(scene: &Scene, camera: &Camera, place: DVec3, random: &mut Stream) -> Option<DVec2> {
    let noise = DVec2::new(random.normal(), random.normal()) * NOISE;
    let (at, _) = camera.seen(place)?;
    let offset = place - camera.center();
    let ray = Ray { origin: camera.center(), direction: offset.normalize() };
    let pixel = ((at + noise) * PARTS).round() / PARTS;
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let is_inside = pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all();
    (is_inside && scene.nearest(&ray).t > offset.length() - HIDING).then_some(pixel)
}
