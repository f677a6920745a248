//! Whether points and cameras belong together.

use super::{Dataset, DatasetError, Photo, Point};
use crate::camera::Camera;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;

/// Points whose colours are compared; of more, every n-th.
const COMPARED: usize = 2_000;
/// Views that they are compared with.
const VIEWS: usize = 12;
/// Fewer comparisons say nothing.
const LEAST_COMPARISONS: usize = 500;
/// So do points of nearly one colour: the least mean difference of two of them, in levels.
const LEAST_DIFFERENCE: f64 = 8.0;
/// Colours differ from the photos by this part of what the colours of other points differ by: they have nothing to do with them. Of
/// clouds that belong to their photos it is 0.3 to 0.7.
const UNRELATED: f64 = 0.9;

/// Number of places that some camera has in its image.
pub fn shown_by_any(cameras: &[Camera], places: impl IndexedParallelIterator<Item = DVec3>) -> usize {
    places.filter(|&place| cameras.iter().any(|camera| camera.seen(place).is_some())).count()
}

/// A sentence of warning where the points' colours have nothing to do with the photos that show them, as of a cloud that was turned
/// or moved against the cameras.
///
/// # Errors
/// A photo that cannot be decoded again.
pub fn unrelated_colors(dataset: &Dataset) -> Result<Option<String>, DatasetError> {
    let points: Vec<Point> =
        dataset.points.iter().step_by(dataset.points.len().div_ceil(COMPARED).max(1)).copied().collect();
    let views: Vec<usize> = dataset.train.iter().step_by(dataset.train.len().div_ceil(VIEWS).max(1)).copied().collect();
    let views = views.par_iter().map(|&view| Ok((dataset.views[view].camera, dataset.views[view].photo.pixels()?)));
    let views = views.collect::<Result<Vec<_>, DatasetError>>()?;
    let compared = |(camera, photo): &(Camera, Arc<Photo>)| {
        let (mut own, mut other, mut count) = (0.0, 0.0, 0);
        for (index, point) in points.iter().enumerate() {
            let Some((at, _)) = camera.seen(point.position) else { continue };
            let pixel = 4 * (at.y as usize * photo.width as usize + at.x as usize);
            let color = [0, 1, 2].map(|c| photo.rgba[pixel + c]);
            if photo.rgba[pixel + 3] >= 128 {
                // Another point: far away in the list, where neighbours in space are often neighbours.
                let stranger = points[(index + points.len() / 2) % points.len()];
                own += difference(color, point.color);
                other += difference(color, stranger.color);
                count += 1;
            }
        }
        (own, other, count)
    };
    let sums: Vec<(f64, f64, usize)> = views.par_iter().map(compared).collect();
    let (own, other, count) = sums.iter().fold((0.0, 0.0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1, sum.2 + one.2));
    let spread = points.iter().zip(points.iter().skip(points.len() / 2)).map(|(a, b)| difference(a.color, b.color));
    let spread = spread.sum::<f64>() / (points.len() - points.len() / 2).max(1) as f64;
    let says_something = count >= LEAST_COMPARISONS && spread >= LEAST_DIFFERENCE;
    Ok((says_something && own > UNRELATED * other).then(|| {
        format!(
            "the colours of the initial points fit the photos no better than chance would ({:.0} levels apart on average, {:.0} by \
             chance): the points may be in other coordinates than the cameras, or without true colours",
            own / count as f64,
            other / count as f64
        )
    }))
}

fn difference(a: [u8; 3], b: [u8; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(b))).sum::<f64>() / 3.0
}
