//! Cloning and splitting by screen-space gradients (method.md section 7): what `published` and `absgs` share.

use super::{FRESH, Observations, Plan, Round, sigmoid};
use glam::{Quat, Vec3};
use ibgs_core::config::DensifyConfig;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// What the views since the last round say of a Gaussian.
pub(super) struct Seen {
    /// Its largest scale is above the one that is cloned.
    pub is_large: bool,
    /// Mean norm of the gradient.
    pub gradient: f64,
    /// Mean norm of the absolute gradient.
    pub absolute: f64,
    /// Largest radius in pixels.
    pub radius: f64,
}

/// What a strategy says of a Gaussian.
pub(super) enum Verdict {
    Keep,
    /// It is split where it is large, else cloned; by its gradient over the threshold.
    Grow(f64),
    /// It is split, one of `abs-max-per-round`; by its absolute gradient.
    SplitToo(f64),
}

#[derive(Clone, Copy, PartialEq)]
enum Fate {
    Keep,
    Clone,
    Split,
}

fn largest_scale(log_scale: &[f32; 3]) -> f64 {
    f64::from(log_scale.iter().fold(f32::MIN, |a, &b| a.max(b))).exp()
}

/// A sample of the Gaussian, by Box and Muller.
fn sample(o: &Observations, i: usize, rng: &mut ChaCha8Rng) -> [f32; 3] {
    let mut normal = || {
        let (u, v): (f32, f32) = (rng.random(), rng.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (std::f32::consts::TAU * v).cos()
    };
    let offset = Vec3::new(normal(), normal(), normal()) * Vec3::from(o.log_scales[i]).exp();
    let [w, x, y, z] = o.rotations[i];
    let rotation = Quat::from_xyzw(x, y, z, w).normalize();
    (Vec3::from(o.means[i]) + rotation * offset).to_array()
}

/// Decides what happens to each Gaussian. Where the cap leaves room for only some, the gradients largest
/// beside their threshold win.
fn fates(o: &Observations, config: &DensifyConfig, extent: f64, verdict: impl Fn(&Seen) -> Verdict) -> Vec<Fate> {
    let n = o.means.len();
    let small = config.scale_threshold * extent;
    let mean_of = |i: usize, k: usize| f64::from(o.statistics[i][k]) / f64::from(o.statistics[i][2].max(1.0));
    let mut fates = vec![Fate::Keep; n];
    let mut growing: Vec<(f64, usize)> = Vec::new();
    let mut by_abs: Vec<(f64, usize)> = Vec::new();
    for (i, fate) in fates.iter_mut().enumerate() {
        let is_large = largest_scale(&o.log_scales[i]) > small;
        let radius = f64::from(o.statistics[i][3]);
        match verdict(&Seen { is_large, gradient: mean_of(i, 0), absolute: mean_of(i, 1), radius }) {
            Verdict::Keep => {}
            Verdict::Grow(by) => {
                *fate = if is_large { Fate::Split } else { Fate::Clone };
                growing.push((by, i));
            }
            Verdict::SplitToo(by) => by_abs.push((by, i)),
        }
    }
    let largest_first = |a: &(f64, usize), b: &(f64, usize)| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1));
    by_abs.sort_by(largest_first);
    by_abs.truncate(config.abs_max_per_round as usize);
    for &(_, i) in &by_abs {
        fates[i] = Fate::Split;
    }
    let room = (config.most() as usize).saturating_sub(n);
    if growing.len() + by_abs.len() > room {
        growing.sort_by(largest_first);
        growing.extend(by_abs);
        for &(_, i) in &growing[room..] {
            fates[i] = Fate::Keep;
        }
    }
    fates
}

/// Clones come first, then splits, then pruning of old and new alike.
pub(super) fn plan(
    o: &Observations,
    config: &DensifyConfig,
    round: &Round<'_>,
    rng: &mut ChaCha8Rng,
    verdict: impl Fn(&Seen) -> Verdict,
) -> Plan {
    let fates = fates(o, config, round.extent, verdict);
    let mut plan = Plan::default();
    let shrink = config.split_divisor.ln() as f32;
    let keep = |i: usize, log_scale: &[f32; 3]| {
        let transparent = round.transparent && sigmoid(o.opacity_logits[i]) < config.prune_opacity;
        let large = round.large && largest_scale(log_scale) > config.prune_scale * round.prune_length;
        let sound = o.is_finite(i) && o.opacity_logits[i].is_finite();
        sound && !(transparent || large)
    };
    let push = |plan: &mut Plan, i: usize, fresh: bool, mean: [f32; 3], log_scale: [f32; 3]| {
        if keep(i, &log_scale) {
            plan.sources.push(i as u32 | if fresh { FRESH } else { 0 });
            plan.means.push(mean);
            plan.log_scales.push(log_scale);
        } else {
            plan.counts[2] += 1;
        }
    };
    for i in (0..fates.len()).filter(|&i| fates[i] != Fate::Split) {
        push(&mut plan, i, false, o.means[i], o.log_scales[i]);
    }
    for i in (0..fates.len()).filter(|&i| fates[i] == Fate::Clone) {
        plan.counts[0] += 1;
        let mean = sample(o, i, rng);
        push(&mut plan, i, true, mean, o.log_scales[i]);
    }
    for i in (0..fates.len()).filter(|&i| fates[i] == Fate::Split) {
        plan.counts[1] += 1;
        for _ in 0..2 {
            let mean = sample(o, i, rng);
            push(&mut plan, i, true, mean, o.log_scales[i].map(|s| s - shrink));
        }
    }
    plan
}
