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

#[cfg(test)]
pub(super) mod tests {
    use super::super::free_space::NOWHERE;
    use super::super::{Round, distance_length, strategy};
    use super::{FRESH, Observations, Plan};
    use glam::DVec3;
    use ibgs_core::config::{DensifyConfig, Strategy};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    pub fn round() -> Round<'static> {
        Round {
            extent: 1.0,
            prune_length: 1.0,
            transparent: true,
            large: false,
            grows: true,
            progress: 0.0,
            until_half: 0,
            free_space: &NOWHERE,
        }
    }

    fn published() -> DensifyConfig {
        DensifyConfig { strategy: Strategy::Published, ..DensifyConfig::default() }
    }

    /// One Gaussian each: (gradient sum, absolute sum, views, radius), log scale, opacity logit.
    pub fn observations(rows: &[([f32; 4], f32, f32)]) -> Observations {
        Observations {
            statistics: rows.iter().map(|r| r.0).collect(),
            means: (0..rows.len()).map(|i| [i as f32, 0.0, 0.0]).collect(),
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; rows.len()],
            log_scales: rows.iter().map(|r| [r.1; 3]).collect(),
            opacity_logits: rows.iter().map(|r| r.2).collect(),
        }
    }

    pub fn planned(rows: &[([f32; 4], f32, f32)], config: &DensifyConfig, round: &Round<'_>) -> Plan {
        strategy(config.strategy).plan(&observations(rows), config, round, &mut ChaCha8Rng::seed_from_u64(1))
    }

    #[test]
    fn small_ones_are_cloned_large_ones_split_quiet_ones_kept() {
        let (small, large) = (0.0005f32.ln(), 0.05f32.ln());
        let rows = [
            ([1e-3, 0.0, 2.0, 5.0], small, 1.0),
            ([1e-3, 0.0, 2.0, 5.0], large, 1.0),
            ([1e-4, 0.0, 2.0, 5.0], large, 1.0),
            // Never seen: no division by zero views.
            ([0.0, 0.0, 0.0, 0.0], small, 1.0),
        ];
        let plan = planned(&rows, &published(), &round());
        assert_eq!(plan.sources, [0, 2, 3, FRESH, FRESH | 1, FRESH | 1]);
        assert_eq!(plan.counts, [1, 1, 0]);
        assert_eq!(plan.means[..3], [[0.0; 3], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]);
        assert_ne!(plan.means[3], [0.0; 3], "the copy is drawn from the Gaussian");
        assert!((plan.log_scales[4][0] - (large - 1.6f32.ln())).abs() < 1e-6);
        assert_eq!(plan.log_scales[3], [small; 3]);
        assert_ne!(plan.means[4], plan.means[5]);
    }

    #[test]
    fn absolute_gradients_split_wide_ones_and_the_largest_win() {
        let large = 0.05f32.ln();
        let rows = [
            ([0.0, 2e-3, 1.0, 21.0], large, 1.0),
            ([0.0, 3e-3, 1.0, 21.0], large, 1.0),
            ([0.0, 3e-3, 1.0, 20.0], large, 1.0),
            ([0.0, 3e-3, 1.0, 90.0], 0.0005f32.ln(), 1.0),
            ([0.0, 7e-4, 1.0, 90.0], large, 1.0),
        ];
        let config = published();
        assert_eq!(planned(&rows, &config, &round()).counts, [0, 2, 0]);
        let one = DensifyConfig { abs_max_per_round: 1, ..config.clone() };
        let plan = planned(&rows, &one, &round());
        assert_eq!(plan.sources, [0, 2, 3, 4, FRESH | 1, FRESH | 1]);
        let off = DensifyConfig { abs_split: false, ..config };
        assert_eq!(planned(&rows, &off, &round()).counts, [0, 0, 0]);
    }

    #[test]
    fn pruning_takes_the_transparent_and_later_the_large() {
        let rows = [([0.0; 4], 0.01f32.ln(), -3.5), ([0.0; 4], 0.2f32.ln(), 1.0), ([0.0; 4], 0.01f32.ln(), 1.0)];
        let config = published();
        assert_eq!(planned(&rows, &config, &round()).sources, [1, 2]);
        assert_eq!(planned(&rows, &config, &Round { large: true, ..round() }).sources, [2]);
        assert_eq!(planned(&rows, &config, &Round { transparent: false, ..round() }).sources, [0, 1, 2]);
    }

    #[test]
    fn far_scenes_are_measured_by_their_distance() {
        let far =
            |x: f32| [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [1e6, 0.0, 0.0], [x - 1.0, 0.0, 0.0], [x + 0.5, 0.0, 0.0]];
        let centre = DVec3::new(-1.0, 0.0, 0.0);
        assert_eq!(distance_length(&far(9.0), centre, 2.0), 10.5);
        assert_eq!(distance_length(&far(4.0), centre, 2.0), 2.0);
        assert_eq!(distance_length(&[], centre, 2.0), 2.0);
        let rows = [([0.0; 4], 0.25f32.ln(), 1.0); 3];
        let round = Round { large: true, ..round() };
        assert_eq!(planned(&rows, &published(), &round).sources, [0; 0]);
        assert_eq!(planned(&rows, &published(), &Round { prune_length: 3.0, ..round }).sources, [0, 1, 2]);
    }

    #[test]
    fn the_cap_is_never_passed() {
        let rows: Vec<_> = (0..50).map(|i| ([1e-3 * (1 + i) as f32, 0.0, 1.0, 1.0], 0.05f32.ln(), 1.0)).collect();
        let config = DensifyConfig { max_splats: Some(55), ..published() };
        let plan = planned(&rows, &config, &round());
        assert_eq!(plan.sources.len(), 55);
        // The largest gradients.
        assert!(plan.sources.iter().filter(|s| **s & FRESH != 0).all(|s| s & !FRESH >= 45));
    }

    #[test]
    fn a_plan_is_repeatable() {
        let rows = [([1e-3, 0.0, 1.0, 1.0], 0.05f32.ln(), 1.0)];
        let config = published();
        assert_eq!(planned(&rows, &config, &round()), planned(&rows, &config, &round()));
    }
}
