//! 3D Gaussian splatting as Markov chain Monte Carlo (Kheradmand et al., NeurIPS 2024): useless Gaussians move to where
//! others are, their number grows to a cap, noise moves the means, and two penalties keep opacities and scales small. Nothing
//! is cloned, split or pruned, and no opacity is reset. The moments of what is moved and of what it is moved onto start at
//! zero.

use super::{FRESH, Observations, Plan, Reduction, Round, Step, Strategy, sigmoid};
use crate::autodiff::SplatGradients;
use crate::parameters::Parameters;
use burn::tensor::{Tensor, activation};
use ibgs_core::config::{DensifyConfig, McmcConfig};
use ibgs_core::gpu::{Pass, flush};
use ibgs_core::raster::iteration_seed;
use ibgs_core::scene::{PerGaussian, Splats};
use ibgs_shaders::bindings::McmcNoiseBindings;
use ibgs_shaders::types::McmcNoiseParams;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Most Gaussians that share one place after a round.
const MOST_COPIES: u32 = 51;

/// Opacity of each of `copies` Gaussians that together stop as much light as one of opacity `o` did, and the factor of their
/// scales that keeps the picture (their equation 9).
pub fn shared(o: f64, copies: u32) -> (f64, f64) {
    let each = 1.0 - (1.0 - o).powf(1.0 / f64::from(copies));
    // The double sum over k < i <= n of binomials (i - 1 over k) is one over binomials (n over j), by the hockey stick.
    let (mut binomial, mut power, mut sum) = (1.0, 1.0, 0.0);
    for j in 1..=copies {
        binomial *= f64::from(copies - j + 1) / f64::from(j);
        power *= each;
        let sign = if j % 2 == 1 { 1.0 } else { -1.0 };
        sum += sign * binomial * power / f64::from(j).sqrt();
    }
    (each, o / sum)
}

/// The strategy `mcmc`.
#[derive(Clone, Copy, Debug)]
pub struct Mcmc;

impl Strategy for Mcmc {
    fn reduction(&self, _: &DensifyConfig, _: f64) -> Option<Reduction> {
        None
    }

    fn plan(&self, o: &Observations, config: &DensifyConfig, round: &Round<'_>, rng: &mut ChaCha8Rng) -> Plan {
        plan(o, config, round, rng)
    }

    /// Adds the gradients of `opacity-weight` times the mean opacity and `scale-weight` times the mean scale.
    fn penalise(&self, gradients: &mut SplatGradients, parameters: &Parameters, config: &DensifyConfig) {
        // burn adds to gradients that the batch may still hold.
        flush();
        let config = &config.mcmc;
        let n = parameters.splats().len().max(1) as f64;
        let opacities = activation::sigmoid(parameters.opacity_logits());
        let slope = opacities.clone() * (opacities.neg() + 1.0);
        let add = |gradient: &mut Option<Tensor<1>>, more| *gradient = gradient.clone().map(|gradient| gradient + more);
        add(&mut gradients.opacity_logits, slope * (config.opacity_weight / n));
        let scales = parameters.log_scales().exp();
        add(&mut gradients.log_scales, scales * (config.scale_weight / (3.0 * n)));
    }

    /// Records a random step of every mean, of its Gaussian's shape and large where the Gaussian is transparent.
    fn record_after_step(&self, pass: &mut Pass, splats: &Splats, config: &DensifyConfig, step: &Step) {
        let count = splats.len();
        let strength = config.mcmc.noise * step.mean_rate;
        // Not the seeds of dropout.
        let seed = iteration_seed(step.seed, step.iteration ^ 0x9e37_79b9);
        let params = McmcNoiseParams { count: count as u32, seed, strength: strength as f32 };
        let PerGaussian { means, log_scales, opacity_logits, .. } = &splats.parameters;
        let rotations = &splats.rotations();
        pass.relabel("noise");
        pass.linear(&McmcNoiseBindings { rotations, log_scales, opacity_logits, means }, &params, count);
    }
}

/// Moves what is transparent or broken to places drawn by opacity, and adds as many as the growth allows.
fn plan(o: &Observations, config: &DensifyConfig, round: &Round<'_>, rng: &mut ChaCha8Rng) -> Plan {
    let n = o.means.len();
    let opacities: Vec<f64> = o.opacity_logits.iter().map(|&logit| sigmoid(logit)).collect();
    let lives = |i: usize| opacities[i] > config.mcmc.dead_opacity && o.is_finite(i);
    let living: Vec<usize> = (0..n).filter(|&i| lives(i)).collect();
    let Some(draws) = Draws::new(&living, &opacities) else {
        // There is nothing to move to, so the model stays as it is.
        let keep = (0..n as u32).collect();
        return Plan { sources: keep, means: o.means.clone(), log_scales: o.log_scales.clone(), ..Plan::default() };
    };
    let to_cap = (f64::from(config.most()) / n.max(1) as f64).powf(1.0 / f64::from(round.until_half.max(1)));
    let growth = config.mcmc.growth.unwrap_or(if round.until_half > 0 {
        to_cap.max(McmcConfig::LEAST_GROWTH)
    } else {
        McmcConfig::LEAST_GROWTH
    });
    let grown = (n as f64 * growth).round() as usize;
    let total = grown.min(config.most() as usize).max(n);
    // The places of the dead Gaussians and of those that are added.
    let moved: Vec<usize> = (living.len()..total).map(|_| draws.draw(rng)).collect();
    let mut copies = vec![1u32; n];
    for &source in &moved {
        copies[source] += 1;
    }
    let mut plan = Plan { opacity_logits: Some(Vec::with_capacity(total)), ..Plan::default() };
    for (i, fresh) in living.iter().map(|&i| (i, copies[i] > 1)).chain(moved.iter().map(|&i| (i, true))) {
        let mut log_scale = o.log_scales[i];
        let mut logit = o.opacity_logits[i];
        if copies[i] > 1 {
            let (opacity, factor) = shared(opacities[i].min(1.0 - 1e-7), copies[i].min(MOST_COPIES));
            let opacity = opacity.max(config.mcmc.dead_opacity);
            logit = (opacity / (1.0 - opacity)).ln() as f32;
            log_scale = log_scale.map(|s| s + factor.ln() as f32);
        }
        plan.push(i as u32 | if fresh { FRESH } else { 0 }, o.means[i], log_scale, logit);
    }
    plan.counts = [total - n, 0, n - living.len()];
    plan
}

/// Draws of Gaussians by opacity.
struct Draws<'a> {
    living: &'a [usize],
    /// Running sums of their opacities.
    sums: Vec<f64>,
}

impl<'a> Draws<'a> {
    fn new(living: &'a [usize], opacities: &[f64]) -> Option<Self> {
        let add = |sum: &mut f64, &i: &usize| {
            *sum += opacities[i];
            Some(*sum)
        };
        let sums: Vec<f64> = living.iter().scan(0.0, add).collect();
        (!sums.is_empty()).then_some(Self { living, sums })
    }

    fn draw(&self, rng: &mut ChaCha8Rng) -> usize {
        let at = rng.random::<f64>() * self.sums[self.sums.len() - 1];
        self.living[self.sums.partition_point(|&sum| sum <= at).min(self.living.len() - 1)]
    }
}
