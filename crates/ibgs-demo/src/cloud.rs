//! The initial points: what structure from motion would find, with its noise and its outliers.

use super::numeric::Stream;
use super::scene::{LAMP, Scene, is_view_dependent};
use super::trace::hit_at;
use glam::DVec3;
use ibgs_data::dataset::{Point, View};
use rayon::prelude::*;

/// Standard deviation of a point along each axis in metres.
const NOISE: f64 = 0.01;
/// Share of points that lie anywhere in the room.
const OUTLIERS: f64 = 0.02;
/// Share of the hits on glossy and mirror-like surfaces that become points: such surfaces match badly. Their points
/// lie on the surface: mirror images in curved surfaces lie close behind it.
const KEPT_ON_MIRRORS: f64 = 0.25;

/// An initial point.
pub(super) struct Found {
    pub point: Point,
    /// The view in which it was found, and the place on a surface that it stands for, where that looks the same from everywhere.
    pub surface: Option<(usize, DVec3)>,
}

/// Points seen in random pixels of the training photos, with the colour of that pixel.
pub(super) fn points(scene: &Scene, (count, seed): (usize, u64), views: &[View], train: &[usize]) -> Vec<Found> {
    (0..count)
        .into_par_iter()
        .map(|index| {
            let mut random = Stream::new(seed, 2, index as u64);
            if random.uniform() < OUTLIERS {
                return outlier(scene, &mut random);
            }
            (0..64)
                .find_map(|_| surface_point(scene, &mut random, views, train))
                .unwrap_or_else(|| outlier(scene, &mut random))
        })
        .collect()
}

fn outlier(scene: &Scene, random: &mut Stream) -> Found {
    let place = DVec3::new(random.signed(), random.signed(), random.signed());
    let color = random.bits().to_le_bytes();
    let point = Point { position: scene.center() + place * scene.half(), color: [color[0], color[1], color[2]] };
    Found { point, surface: None }
}

fn surface_point(scene: &Scene, random: &mut Stream, views: &[View], train: &[usize]) -> Option<Found> {
    let number = train[random.below(train.len())];
    let view = &views[number];
    let x = random.below(view.camera.width as usize);
    let y = random.below(view.camera.height as usize);
    let keep = random.uniform() < KEPT_ON_MIRRORS;
    let (hit, ray) = hit_at(scene, &view.camera, x as f64, y as f64);
    if hit.id == LAMP || (is_view_dependent(hit.id) && !keep) {
        return None;
    }
    let noise = DVec3::new(random.normal(), random.normal(), random.normal()) * NOISE;
    let pixel = (y * view.camera.width as usize + x) * 4;
    let photo = view.photo.pixels().ok()?;
    let rgba = &photo.rgba[pixel..pixel + 4];
    let point = Point { position: ray.at(hit.t) + noise, color: [rgba[0], rgba[1], rgba[2]] };
    let surface = (!is_view_dependent(hit.id)).then(|| (number, ray.at(hit.t)));
    Some(Found { point, surface })
}
