//! AbsGS (Ye et al., 2024): the absolute gradient alone says which large Gaussians are split.

use super::gradient::{self, Verdict};
use super::{Observations, Over, Plan, Reduction, Round, Strategy};
use ibgs_core::config::DensifyConfig;
use rand_chacha::ChaCha8Rng;

/// The strategy `absgs`.
#[derive(Clone, Copy, Debug)]
pub struct AbsGs;

impl Strategy for AbsGs {
    fn reduction(&self, config: &DensifyConfig, extent: f64) -> Option<Reduction> {
        Some(Reduction { over: Over::Sum, near_depth: config.near_depth * extent })
    }

    fn plan(&self, o: &Observations, config: &DensifyConfig, round: &Round<'_>, rng: &mut ChaCha8Rng) -> Plan {
        gradient::plan(o, config, round, rng, |seen| {
            let (gradient, threshold) = match seen.is_large {
                true => (seen.absolute, config.absgs_threshold),
                false => (seen.gradient, config.grad_threshold),
            };
            if gradient >= threshold { Verdict::Grow(gradient / threshold) } else { Verdict::Keep }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::FRESH;
    use super::super::gradient::tests::{planned, round};
    use ibgs_core::config::{DensifyConfig, Strategy};

    #[test]
    fn it_splits_by_the_absolute_gradient_alone() {
        let (small, large) = (0.0005f32.ln(), 0.05f32.ln());
        let rows = [
            ([1e-3, 0.0, 1.0, 90.0], large, 1.0),
            ([0.0, 5e-4, 1.0, 1.0], large, 1.0),
            ([0.0, 3e-4, 1.0, 90.0], large, 1.0),
            ([3e-4, 0.0, 1.0, 1.0], small, 1.0),
            ([1e-4, 9e-3, 1.0, 1.0], small, 1.0),
        ];
        let config = DensifyConfig { strategy: Strategy::AbsGs, abs_max_per_round: 0, ..DensifyConfig::default() };
        let plan = planned(&rows, &config, &round());
        assert_eq!(plan.sources, [0, 2, 3, 4, FRESH | 3, FRESH | 1, FRESH | 1]);
        // Where there is room for one, gradients are weighed by their thresholds.
        let one = DensifyConfig { max_splats: Some(6), ..config };
        assert_eq!(planned(&rows, &one, &round()).counts, [1, 0, 0]);
    }
}
