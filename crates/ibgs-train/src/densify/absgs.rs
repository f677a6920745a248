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
