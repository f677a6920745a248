//! Sorts Gaussians so that neighbours in space are neighbours in the file: chunks have smaller ranges, and pictures
//! compress better.

use super::super::Gaussians;

/// Indices along a Morton curve with 1024 cells along each axis of the bounds; equal cells stay in their order.
pub(super) fn morton(gaussians: &Gaussians) -> Vec<usize> {
    let axis = |axis: usize| gaussians.means.iter().map(move |mean| f64::from(mean[axis]));
    let ranges: [(f64, f64); 3] = std::array::from_fn(|i| {
        axis(i).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    });
    let cell = |mean: &[f32; 3]| -> u32 {
        let along = |i: usize| {
            let (low, high) = ranges[i];
            let part = if high > low { (f64::from(mean[i]) - low) / (high - low) } else { 0.0 };
            spread((part * 1023.0) as u32)
        };
        along(0) | along(1) << 1 | along(2) << 2
    };
    let mut order: Vec<usize> = (0..gaussians.len()).collect();
    order.sort_by_cached_key(|&index| cell(&gaussians.means[index]));
    order
}

/// Ten bits with two zeros between each.
fn spread(value: u32) -> u32 {
    (0..10).fold(0, |bits, bit| bits | (value >> bit & 1) << (3 * bit))
}
