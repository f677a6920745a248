//! Which points of a COLMAP model to begin with.

use crate::dataset::Point;

/// A point as the file states it.
#[derive(Clone, Copy, Debug)]
pub(super) struct SparsePoint {
    pub id: u64,
    pub point: Point,
    /// Mean reprojection error in pixels.
    pub error: f64,
    /// Number of different images in its track.
    pub images: usize,
}

/// Largest reprojection error in pixels and fewest images of a point that is used (method.md section 10.9).
const MOST_ERROR: f64 = 2.0;
const LEAST_IMAGES: usize = 3;

/// Number of different images in a track.
pub(super) fn distinct(mut images: Vec<u32>) -> usize {
    images.sort_unstable();
    images.dedup();
    images.len()
}

/// The points with a small error and enough images; all of them where the model has no tracks or nothing would be left.
pub(super) fn reliable(points: Vec<SparsePoint>, notes: &mut Vec<String>) -> Vec<SparsePoint> {
    if points.iter().all(|sparse| sparse.images == 0) {
        notes.push("filter-points: the model has no tracks, so all its points are used".to_owned());
        return points;
    }
    // NaN, or COLMAP's -1 for unknown, says nothing against a point.
    let keep =
        |sparse: &&SparsePoint| (sparse.error <= MOST_ERROR || sparse.error.is_nan()) && sparse.images >= LEAST_IMAGES;
    let kept: Vec<SparsePoint> = points.iter().filter(keep).copied().collect();
    if kept.is_empty() {
        notes.push("filter-points: it would leave no point of the model, so all are used".to_owned());
        return points;
    }
    notes.push(format!(
        "filter-points: {} of {} points left out (reprojection error over {MOST_ERROR} pixels or fewer than \
         {LEAST_IMAGES} images)",
        points.len() - kept.len(),
        points.len()
    ));
    kept
}
