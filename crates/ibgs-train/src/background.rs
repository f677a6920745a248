//! The colour behind the Gaussians while they are trained.

use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::Masks;
use ibgs_core::raster::iteration_seed;

/// Separates these random numbers from others of the same seed.
const STREAM: u32 = 0x51ab_07e5;

/// Colour behind Gaussians and photos in an iteration's loss: the run's own, but with masks of an object another one in each
/// iteration, by seed and iteration alone. A Gaussian of any one colour differs from most of them, so only emptiness satisfies the loss.
pub(super) fn iteration_background(config: &TrainConfig, iteration: u32) -> [f32; 3] {
    match config.data.masks {
        Masks::Ignore => config.background(),
        Masks::Object => {
            let [r, g, b, _] = iteration_seed(config.seed, iteration ^ STREAM).to_le_bytes();
            [r, g, b].map(|level| f32::from(level) / 255.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_object_has_another_background_in_each_iteration() {
        let mut config = TrainConfig { white_background: true, ..TrainConfig::default() };
        assert_eq!(iteration_background(&config, 7), [1.0; 3]);
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
