//! The published strategy (method.md section 7): by mean gradients of the projected means and, for wide Gaussians, by absolute
//! gradients.

use super::gradient::{self, Verdict};
use super::{Observations, Over, Plan, Reduction, Round, Strategy};
use ibgs_core::config::DensifyConfig;
use rand_chacha::ChaCha8Rng;

/// The strategy `published`.
#[derive(Clone, Copy, Debug)]
pub struct Published;

impl Strategy for Published {
    fn reduction(&self, config: &DensifyConfig, extent: f64) -> Option<Reduction> {
        Some(Reduction { over: Over::Sum, near_depth: config.near_depth * extent })
    }

    fn plan(&self, o: &Observations, config: &DensifyConfig, round: &Round<'_>, rng: &mut ChaCha8Rng) -> Plan {
        gradient::plan(o, config, round, rng, |seen| {
            let is_wide = config.abs_split && seen.is_large && seen.radius > config.abs_min_radius;
            if seen.gradient >= config.grad_threshold {
                Verdict::Grow(seen.gradient / config.grad_threshold)
            } else if is_wide && seen.absolute >= config.abs_grad_threshold {
                Verdict::SplitToo(seen.absolute)
            } else {
                Verdict::Keep
            }
        })
    }
}
