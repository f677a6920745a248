//! The colour behind the Gaussians while they are trained.

use ibgs_core::config::{Background, TrainConfig};
use ibgs_core::raster::iteration_seed;

/// Separates these random numbers from others of the same seed.
const STREAM: u32 = 0x51ab_07e5;
/// Of 256 iterations with an object this many are over a random colour: enough to leave nothing that hides before its own background,
/// on which the others train what is measured.
const RANDOM_OF_256: u8 = 64;

/// Colour behind Gaussians and photos in an iteration's loss: the run's own, but behind an object another one in a quarter of the
/// iterations, and in each where the options ask for it, by seed and iteration alone. A Gaussian of any one colour differs from
/// most of them, so only emptiness satisfies the loss.
pub(super) fn iteration_background(config: &TrainConfig, iteration: u32) -> [f32; 3] {
    let [r, g, b, chance] = iteration_seed(config.seed, iteration ^ STREAM).to_le_bytes();
    let is_random =
        config.background == Some(Background::Random) || (config.data.shows_object() && chance < RANDOM_OF_256);
    if is_random { [r, g, b].map(|level| f32::from(level) / 255.0) } else { config.background() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ibgs_core::dataset::Masks;

    #[test]
    fn an_object_has_another_background_in_a_quarter_of_the_iterations() {
        let mut config = TrainConfig { background: Some(Background::WHITE), ..TrainConfig::default() };
        assert_eq!(iteration_background(&config, 7), [1.0; 3]);
        config.data.masks = Some(Masks::Object);
        let others = (1..=4000).filter(|&i| iteration_background(&config, i) != [1.0; 3]).count();
        assert!((950..1050).contains(&others), "{others}");
    }

    #[test]
    fn random_backgrounds_are_of_all_colours() {
        let config = TrainConfig { background: Some(Background::Random), ..TrainConfig::default() };
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
