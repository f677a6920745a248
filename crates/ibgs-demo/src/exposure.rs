//! The demo scene as a camera with automatic exposure would take it.

use ibgs_data::dataset::{Dataset, DatasetError, Photo};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Stops up or down, at most.
const STOPS: f64 = 0.3;
/// Part of the full range that is added or taken away, at most.
const OFFSET: f64 = 0.02;

/// Gives every photo, in the order of their names, a gain of 2^u, u uniform in +-0.3, and an offset uniform in +-0.02, on the
/// stored values; what leaves their range is clamped.
///
/// # Errors
/// A photo cannot be decoded again.
pub fn change_exposure(dataset: &mut Dataset, seed: u64) -> Result<(), DatasetError> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for view in &mut dataset.views {
        let gain = rng.random_range(-STOPS..STOPS).exp2();
        let offset = rng.random_range(-OFFSET..OFFSET);
        let change = |v: u8| ((f64::from(v) * gain + 255.0 * offset).clamp(0.0, 255.0) + 0.5) as u8;
        let photo = view.photo.pixels()?;
        let changed = photo.rgba.chunks_exact(4).flat_map(|p| [change(p[0]), change(p[1]), change(p[2]), p[3]]);
        view.photo = Photo { rgba: changed.collect(), ..*photo }.into();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DemoOptions;

    #[test]
    fn exposures_differ_within_their_range_and_repeat() {
        let options = DemoOptions { width: 16, height: 12, views: 9, samples: 1, points: 10, seed: 0 };
        let folder = tempfile::tempdir().unwrap();
        let plain = crate::load(&options, Some(folder.path()), &()).unwrap();
        let changed = |seed| {
            let mut dataset = plain.clone();
            change_exposure(&mut dataset, seed).unwrap();
            dataset.views.into_iter().map(|view| view.photo.pixels().unwrap().rgba.clone()).collect::<Vec<_>>()
        };
        let first = changed(1);
        assert!(first == changed(1) && first != changed(2));
        let mean = |rgba: &[u8]| rgba.chunks_exact(4).map(|p| f64::from(p[1])).sum::<f64>();
        let ratios: Vec<f64> = plain
            .views
            .iter()
            .zip(&first)
            .map(|(view, now)| mean(now) / mean(&view.photo.pixels().unwrap().rgba))
            .collect();
        let (least, most) =
            (ratios.iter().copied().fold(f64::MAX, f64::min), ratios.iter().copied().fold(0.0, f64::max));
        assert!(least > 0.7 && most < 1.4 && most - least > 0.1, "{ratios:?}");
    }
}
