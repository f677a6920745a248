//! Twin of the plane sweep: the depth of a pixel by comparing photos on planes.

use glam::{DVec2, DVec3};
use ibgs_data::dataset::Photo;
use ibgs_render::sources::sweep::SweepView;

const REACH: i64 = 2;
const LEAST_VARIANCE: f64 = 2e-5;

fn texel(photo: &Photo, x: i64, y: i64) -> Option<f64> {
    let at = 4 * (y as usize * photo.width as usize + x as usize);
    let [r, g, b, a] = [0, 1, 2, 3].map(|c| f64::from(photo.rgba[at + c]));
    (a >= 128.0).then_some((0.299 * r + 0.587 * g + 0.114 * b) / 255.0)
}

/// Bilinear brightness at texel coordinates; none beside the photo or where it is masked.
fn read(photo: &Photo, at: DVec2) -> Option<f64> {
    let last = DVec2::new(f64::from(photo.width), f64::from(photo.height)) - 1.0;
    if at.cmplt(DVec2::ZERO).any() || at.cmpgt(last).any() || at.is_nan() {
        return None;
    }
    let first = at.floor().min(last - 1.0);
    let (f, x, y) = (at - first, first.x as i64, first.y as i64);
    let [t00, t10, t01, t11] =
        [texel(photo, x, y)?, texel(photo, x + 1, y)?, texel(photo, x, y + 1)?, texel(photo, x + 1, y + 1)?];
    let (upper, lower) = (t00 + (t10 - t00) * f.x, t01 + (t11 - t01) * f.x);
    Some(upper + (lower - upper) * f.y)
}

fn taps() -> impl Iterator<Item = (i64, i64)> {
    (-REACH..=REACH).flat_map(|y| (-REACH..=REACH).map(move |x| (x, y)))
}

/// Correlation of the surroundings of a pixel with what a source shows of them on the plane at a depth.
pub fn correlation(target: &SweepView, source: &SweepView, (x, y): (i64, i64), depth: f64) -> Option<f64> {
    let own: Vec<f64> = taps().map(|(u, v)| texel(&target.photo, x + u, y + v)).collect::<Option<_>>()?;
    let other = taps().map(|(u, v)| {
        let at = DVec2::new((x + u) as f64 + 0.5, (y + v) as f64 + 0.5);
        let (there, z) = source.camera.project(target.camera.unproject(at, depth));
        if z > 0.0 { read(&source.photo, there - 0.5) } else { None }
    });
    let other: Vec<f64> = other.collect::<Option<_>>()?;
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (a, b) = (mean(&own), mean(&other));
    let product: Vec<f64> = own.iter().zip(&other).map(|(x, y)| (x - a) * (y - b)).collect();
    let variance = |v: &[f64], m: f64| mean(&v.iter().map(|x| (x - m) * (x - m)).collect::<Vec<_>>());
    let (va, vb) = (variance(&own, a), variance(&other, b));
    (va >= LEAST_VARIANCE && vb >= LEAST_VARIANCE).then(|| mean(&product) / (va * vb).sqrt())
}

/// Scores of a pixel on all planes: the mean of the best three sources, of two where no third shows it.
pub fn scores(target: &SweepView, sources: &[&SweepView], pixel: (i64, i64), depths: &[f64]) -> Vec<Option<f64>> {
    let (w, h) = (i64::from(target.photo.width), i64::from(target.photo.height));
    let inside = pixel.0 >= REACH && pixel.1 >= REACH && pixel.0 + REACH < w && pixel.1 + REACH < h;
    let score = |&depth: &f64| {
        if !inside {
            return None;
        }
        let mut all: Vec<f64> = sources.iter().filter_map(|source| correlation(target, source, pixel, depth)).collect();
        all.sort_by(|a, b| b.total_cmp(a));
        all.truncate(3);
        (all.len() >= 2).then(|| all.iter().sum::<f64>() / all.len() as f64)
    };
    depths.iter().map(score).collect()
}

/// Inverse depths of the planes.
pub fn planes([nearest, farthest]: [f64; 2], count: u32) -> Vec<f64> {
    let step = (farthest - nearest) / f64::from(count - 1);
    (0..count).map(|plane| nearest + step * f64::from(plane)).collect()
}

/// Depth, between planes too, and score of the best plane; none where no plane has a score.
pub fn best(inverse: &[f64], scores: &[Option<f64>]) -> Option<(f64, f64)> {
    let known = scores.iter().enumerate().filter_map(|(plane, score)| Some((plane, (*score)?)));
    let (plane, score) = known.reduce(|best, next| if next.1 > best.1 { next } else { best })?;
    let beside = |plane: Option<usize>| plane.and_then(|plane| scores.get(plane).copied().flatten());
    let mut offset = 0.0;
    if let (Some(before), Some(after)) = (beside(plane.checked_sub(1)), beside(Some(plane + 1))) {
        let bend = before + after - 2.0 * score;
        if bend < 0.0 {
            offset = (0.5 * (before - after) / bend).clamp(-0.5, 0.5);
        }
    }
    let step = inverse[1] - inverse[0];
    Some((1.0 / (inverse[plane] + step * offset), score))
}

/// A textured wall, `z = 4 + slope x`, and how a camera photographs it.
pub fn wall_photo(camera: &ibgs_data::camera::Camera, slope: f64) -> Photo {
    let texture = |p: DVec3| {
        let wave = |k: f64, s: f64| (k * p.x + s).sin() * (k * 1.3 * p.y + 2.0 * s).cos();
        [0.0, 0.4, 0.9].map(|s| 0.5 + 0.2 * wave(9.0, s) + 0.15 * wave(23.0, 1.0 + s) + 0.1 * wave(41.0, 2.0 + s))
    };
    let pixel = |i: u32| {
        let at = DVec2::new(f64::from(i % camera.width) + 0.5, f64::from(i / camera.width) + 0.5);
        let (centre, ray) = (camera.center(), camera.ray(at));
        let t = (4.0 + slope * centre.x - centre.z) / (ray.z - slope * ray.x);
        let color = texture(centre + t * ray).map(|v| (255.0 * v).round().clamp(0.0, 255.0) as u8);
        [color[0], color[1], color[2], 255]
    };
    let rgba = (0..camera.width * camera.height).flat_map(pixel).collect();
    Photo { width: camera.width, height: camera.height, rgba }
}
