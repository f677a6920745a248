//! The colour behind the Gaussians while they are trained.

use ibgs_core::config::{Background, TrainConfig};
use ibgs_core::raster::iteration_seed;

/// Separates these random numbers from others of the same seed.
const STREAM: u32 = 0x51ab_07e5;

/// Colour behind Gaussians and photos in an iteration's loss: the run's own, but behind an object, and where the options ask for it,
/// another one in each iteration, by seed and iteration alone. A Gaussian of any one colour differs from most of them, so only emptiness satisfies the loss.
pub(super) fn iteration_background(config: &TrainConfig, iteration: u32) -> [f32; 3] {
    if !config.shows_object() && config.background != Some(Background::Random) {
        return config.background();
    }
    let [r, g, b, _] = iteration_seed(config.seed, iteration ^ STREAM).to_le_bytes();
    [r, g, b].map(|level| f32::from(level) / 255.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ibgs_core::dataset::Masks;

    #[test]
    fn an_object_has_another_background_in_each_iteration() {
        let mut config = TrainConfig { background: Some(Background::WHITE), ..TrainConfig::default() };
        assert_eq!(iteration_background(&config, 7), [1.0; 3]);
        let random = TrainConfig { background: Some(Background::Random), ..TrainConfig::default() };
        assert_ne!(iteration_background(&random, 7), iteration_background(&random, 8));
        config.data.masks = Masks::Object;
        let all: Vec<[f32; 3]> = (1..=4000).map(|i| iteration_background(&config, i)).collect();
        for c in 0..3 {
            let mean = all.iter().map(|color| color[c]).sum::<f32>() / 4000.0;
            let variance = all.iter().map(|color| (color[c] - mean).powi(2)).sum::<f32>() / 4000.0;
            assert!((mean - 0.5).abs() < 0.02 && (variance - 1.0 / 12.0).abs() < 0.005, "{mean}, {variance}");
        }
        assert_eq!(iteration_background(&config, 1), all[0]);
        let other = TrainConfig { seed: config.seed + 1, ..config };
        assert_ne!(iteration_background(&other, 1), all[0]);
    }
}
