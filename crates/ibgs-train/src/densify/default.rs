//! The default strategy: no opacity resets. What has faded is pruned in every round and replaced by splitting others; while the
//! model grows, a share of the Gaussians with large screen-space gradients is split as well, by the largest absolute gradient (Ye et
//! al., AbsGS, 2024) over the views; every opacity loses a little. One operation adds Gaussians: a split in two that keeps mass, centre and, along the axes, the second moments. Ideas and
//! constants of Brush 1.0, which also has the screen-size rule.

use super::{FRESH, Observations, Over, Plan, Reduction, Round, Strategy, sigmoid};
use glam::{Quat, Vec3};
use ibgs_core::config::{DensifyConfig, GrowthConfig};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::f64::consts::FRAC_1_SQRT_2;

/// Gaussians with a scale above this many extents are removed.
const LARGEST: f64 = 100.0;
/// Opacities stay under this, so that their logit is finite.
const MOST_OPACITY: f64 = 1.0 - 1e-6;

/// Scales of the two halves of a split relative to the whole's, and the distance of each half from the centre along each axis:
/// the longest axis shrinks by the root of one half, an axis much shorter than it hardly at all, and k^2 s^2 + d^2 = s^2.
pub fn halves(scales: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let largest = scales.iter().fold(f64::MIN_POSITIVE, |a, &b| a.max(b));
    let shrink = scales.map(|s| 1.0 - (s / largest).powi(2) * (1.0 - FRAC_1_SQRT_2));
    let offset = std::array::from_fn(|a| (1.0 - shrink[a] * shrink[a]).sqrt() * scales[a]);
    (shrink, offset)
}

/// Opacity of each half of a split.
pub fn half_opacity(opacity: f64) -> f64 {
    1.0 - (1.0 - opacity).powf(FRAC_1_SQRT_2)
}

/// What a round looks at.
struct Candidates<'a> {
    o: &'a Observations,
    config: &'a GrowthConfig,
    opacities: Vec<f64>,
}

impl Candidates<'_> {
    fn lives(&self, i: usize, extent: f64) -> bool {
        self.opacities[i] >= self.config.prune_opacity
            && self.o.is_finite(i)
            && self.o.log_scales[i].iter().all(|s| f64::from(*s).exp() <= LARGEST * extent)
    }

    fn gradient(&self, i: usize) -> f64 {
        f64::from(self.o.statistics[i][0])
    }

    /// May be split for its gradient.
    fn is_rough(&self, i: usize) -> bool {
        self.gradient(i) > self.config.threshold
    }

    /// Wider on the screen than allowed.
    fn is_wide(&self, i: usize) -> bool {
        self.config.screen_size > 0.0 && f64::from(self.o.statistics[i][3]) > self.config.screen_size
    }
}

/// `amount` of the Gaussians in `from`, drawn without replacement by weight, marked in `split`; returns how many were new.
fn draw(
    from: &[usize],
    weight: impl Fn(usize) -> f64 + Sync,
    amount: usize,
    split: &mut [bool],
    rng: &mut ChaCha8Rng,
) -> usize {
    // The largest keys u^(1/w) are such a draw (Efraimidis and Spirakis, 2006); by logarithms.
    let mut keys: Vec<(f64, usize)> =
        from.iter().filter(|&&i| !split[i] && weight(i) > 0.0).map(|&i| (1.0 - rng.random::<f64>(), i)).collect();
    keys.par_iter_mut().for_each(|(key, i)| *key = key.ln() / weight(*i));
    let amount = amount.min(keys.len());
    if amount > 0 && amount < keys.len() {
        keys.select_nth_unstable_by(amount - 1, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    }
    for &(_, i) in &keys[..amount] {
        split[i] = true;
    }
    amount
}

/// The strategy `default`.
#[derive(Clone, Copy, Debug)]
pub struct Growth;

impl Strategy for Growth {
    fn reduction(&self, _: &DensifyConfig, _: f64) -> Option<Reduction> {
        Some(Reduction { over: Over::Largest, near_depth: 0.0 })
    }

    fn free_space(&self, config: &DensifyConfig) -> f64 {
        config.growth.free_space
    }

    fn plan(&self, o: &Observations, config: &DensifyConfig, round: &Round<'_>, rng: &mut ChaCha8Rng) -> Plan {
        plan(o, config, round, rng)
    }
}

/// Prunes, chooses what is split, splits, and lets the opacities fade.
fn plan(o: &Observations, config: &DensifyConfig, round: &Round<'_>, rng: &mut ChaCha8Rng) -> Plan {
    let n = o.means.len();
    let growth = &config.growth;
    let opacities: Vec<f64> = o.opacity_logits.par_iter().map(|&logit| sigmoid(logit)).collect();
    let candidates = Candidates { o, config: growth, opacities };
    let in_free_space = round.free_space.contains(&o.means);
    let lives = |&i: &usize| candidates.lives(i, round.extent) && !in_free_space[i];
    let living: Vec<usize> = (0..n).into_par_iter().filter(lives).collect();
    let pruned = n - living.len();
    let mut split = vec![false; n];
    if round.grows {
        let mut room = (config.most() as usize).saturating_sub(living.len());
        for &i in living.iter().filter(|&&i| candidates.is_wide(i)).take(room) {
            split[i] = true;
            room -= 1;
        }
        let seen = |i: usize| if o.statistics[i][2] > 0.0 { candidates.opacities[i] } else { 0.0 };
        let replaced = draw(&living, seen, pruned.min(room), &mut split, rng);
        let above: Vec<usize> = living.iter().copied().filter(|&i| candidates.is_rough(i)).collect();
        let wanted = ((above.len() as f64 * growth.fraction) as usize).saturating_sub(replaced);
        draw(&above, |i| candidates.gradient(i), wanted.min(room - replaced), &mut split, rng);
    }
    let fade = growth.opacity_decay * (1.0 - round.progress);
    let logits: Vec<f32> = living
        .par_iter()
        .map(|&i| match (split[i], candidates.opacities[i]) {
            (true, opacity) => logit(half_opacity(opacity) - fade),
            (false, opacity) if fade > 0.0 => logit(opacity - fade),
            (false, _) => o.opacity_logits[i],
        })
        .collect();
    let mut plan = Plan { opacity_logits: Some(Vec::with_capacity(n)), ..Plan::default() };
    let mut halves_of = Vec::new();
    for (&i, &logit) in living.iter().zip(&logits) {
        if split[i] {
            let (first, second) = split_in_two(o, i, rng);
            plan.push(i as u32 | FRESH, first.0, first.1, logit);
            halves_of.push((i, second, logit));
        } else {
            plan.push(i as u32, o.means[i], o.log_scales[i], logit);
        }
    }
    plan.counts = [0, halves_of.len(), pruned];
    for (i, (mean, log_scale), logit) in halves_of {
        plan.push(i as u32 | FRESH, mean, log_scale, logit);
    }
    plan
}

/// The logit of an opacity, limited to finite values; a Gaussian that has faded to nothing is pruned in the next round.
fn logit(opacity: f64) -> f32 {
    let opacity = opacity.clamp(1e-5, MOST_OPACITY);
    (opacity / (1.0 - opacity)).ln() as f32
}

/// Mean and logarithms of the scales of both halves. Which way each axis points is drawn.
#[expect(clippy::type_complexity, reason = "two pairs")]
fn split_in_two(o: &Observations, i: usize, rng: &mut ChaCha8Rng) -> (([f32; 3], [f32; 3]), ([f32; 3], [f32; 3])) {
    let (shrink, offset) = halves(o.log_scales[i].map(|s| f64::from(s).exp()));
    let log_scale = std::array::from_fn(|a| o.log_scales[i][a] + shrink[a].ln() as f32);
    let signed = offset.map(|d| if rng.random::<bool>() { d as f32 } else { -d as f32 });
    let [w, x, y, z] = o.rotations[i];
    let step = Quat::from_xyzw(x, y, z, w).normalize() * Vec3::from(signed);
    let mean = Vec3::from(o.means[i]);
    (((mean + step).to_array(), log_scale), ((mean - step).to_array(), log_scale))
}
