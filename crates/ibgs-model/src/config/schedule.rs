//! When things happen in a training run (method.md section 7), with milestones resolved for its length.

mod rounds;
mod stages;

pub use stages::Stages;

use super::{Background, ShortRuns, TrainConfig};

/// Length of the run that the reference milestones belong to.
pub const REFERENCE_ITERATIONS: u32 = 30_000;

/// Runs shorter than this scale the start and the interval of densification too.
const SHORT_RUN: u32 = 5_000;

/// The same for [`ShortRuns::SameRounds`], whose rounds are fewer.
const SHORT_SAME_ROUNDS: u32 = 4_000;

/// Least start and interval of densification after scaling.
const SHORTEST_ROUND: u32 = 20;

/// Iteration after which a run is evaluated and saved for the first time, unless options say otherwise.
const FIRST_REPORT: u32 = 7_000;

/// All milestones of one run as absolute iterations, which count from 1. An event at iteration i belongs to that
/// iteration's step: SH degree and learning rates hold in it, densification and resets follow its gradients.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// Number of iterations.
    pub iterations: u32,
    /// Degree of the spherical harmonics that is reached in the end.
    pub max_sh_degree: u32,
    /// Iterations between two degrees.
    pub sh_interval: u32,
    /// Rate of the means at the start, for extent 1.
    pub mean_lr_initial: f64,
    /// Rate of the means at the end, for extent 1.
    pub mean_lr_final: f64,
    /// Factor on the Gaussians' other rates.
    pub rate_factor: f64,
    /// Iterations over which the rate of the means falls.
    pub mean_iterations: u32,
    /// Opacities are reset while the number of Gaussians grows.
    pub resets_opacity: bool,
    /// Densification comes after this iteration.
    pub densify_start: u32,
    /// The number of Gaussians grows before this iteration.
    pub densify_end: u32,
    /// Rounds come before this iteration.
    pub rounds_end: u32,
    /// Densification comes at multiples of this.
    pub densify_interval: u32,
    /// Opacity resets come at multiples of this, before `densify_end`.
    pub opacity_reset_interval: u32,
    /// An opacity reset of its own, where the background is white.
    pub white_reset: Option<u32>,
    /// Large Gaussians are pruned after this iteration.
    pub prune_large_after: u32,
    /// Evaluation comes at multiples of this; 0: never for this reason.
    pub eval_every: u32,
    /// Iterations to evaluate at, besides the last.
    pub eval_iterations: Vec<u32>,
    /// Iterations to save at, besides the last.
    pub save_iterations: Vec<u32>,
    /// Exposures are learned after this iteration.
    pub exposure_start: u32,
    /// Learning rates of the exposures at the start and at the end.
    pub exposure_lr: [f64; 2],
    /// Cameras learn after the first of these iterations, up to the last.
    pub poses_between: [u32; 2],
    /// Learning rates of the cameras at the start and at the end.
    pub poses_lr: [f64; 2],
    /// Masks of what moves are learned after this iteration.
    pub transients_start: u32,
    /// Milestones of the image-based stages; none for plain splatting.
    pub stages: Option<Stages>,
}

/// For a run that begins with a finished model: the first rate of the means as a multiple of the last one, and the
/// factor on the Gaussians' other rates. At full rates a converged model first gets worse.
const WARM_MEAN_RATE: f64 = 1.0;
const WARM_RATES: f64 = 0.1;

impl Schedule {
    /// Resolves the milestones of `config` for a run of `n_iterations`. With `schedule-scaling` they follow
    /// `n_iterations / 30000`, except start and interval of densification, which fall with the length only in runs under
    /// 5000 iterations (4000 with [`ShortRuns::SameRounds`]) and never under 20. A milestone that `config` gives is taken as it is.
    pub fn new(config: &TrainConfig, n_iterations: u32) -> Self {
        let densify = &config.densify;
        let scaled = |reference: u32| {
            if config.schedule_scaling { scale(reference, n_iterations) } else { reference }
        };
        let factor = config.learning_rates.factor.unwrap_or(1.0);
        let strategy = densify.strategy.defaults();
        let scaled_if_short = |reference: u32| match strategy.short_runs {
            _ if !config.schedule_scaling => reference,
            ShortRuns::SameRounds if n_iterations < SHORT_SAME_ROUNDS => {
                let part = u64::from(reference) * u64::from(n_iterations) / u64::from(SHORT_SAME_ROUNDS);
                u32::try_from(part).unwrap_or(u32::MAX).max(SHORTEST_ROUND)
            }
            ShortRuns::AsMilestones if n_iterations < SHORT_RUN => scaled(reference).max(SHORTEST_ROUND),
            _ => reference,
        };
        let warm = config.init.is_some();
        let densify_start = densify.start.unwrap_or_else(|| scaled_if_short(500));
        let reset_interval = config.opacity_reset.interval.unwrap_or_else(|| scaled(3_000));
        let reports = |list: &Option<Vec<u32>>| match list {
            Some(list) => list.clone(),
            None => vec![scaled(FIRST_REPORT)],
        };
        let (rates, exposure) = (&config.learning_rates, &config.exposure);
        let densify_end = densify.end.unwrap_or_else(|| if warm { 1 } else { scaled(strategy.end) });
        // As many rounds as at full rates.
        let slow = if strategy.rounds_follow_rates { factor.min(1.0) } else { 1.0 };
        let interval = (f64::from(strategy.interval) / slow).round() as u32;
        Self {
            iterations: n_iterations,
            max_sh_degree: config.sh_degree(),
            sh_interval: config.sh_interval.unwrap_or_else(|| if warm { 1 } else { scaled(1_000) }),
            // A finished model's means are near where they belong.
            mean_lr_initial: factor * if warm { WARM_MEAN_RATE * rates.mean_final } else { rates.mean_initial },
            mean_lr_final: factor * rates.mean_final,
            rate_factor: factor * if warm { WARM_RATES } else { 1.0 },
            mean_iterations: rates.mean_iterations.unwrap_or_else(|| scaled(REFERENCE_ITERATIONS)),
            resets_opacity: strategy.resets_opacity,
            densify_start,
            densify_end,
            rounds_end: if strategy.rounds_to_end && !warm { n_iterations } else { densify_end },
            densify_interval: densify.interval.unwrap_or_else(|| scaled_if_short(interval)),
            opacity_reset_interval: reset_interval,
            white_reset: (config.background == Some(Background::WHITE)).then_some(densify_start),
            prune_large_after: densify.prune_scale_after.unwrap_or(reset_interval),
            eval_every: config.eval_every,
            eval_iterations: reports(&config.eval_iterations),
            save_iterations: reports(&config.save_iterations),
            exposure_start: exposure.from.unwrap_or_else(|| scaled(1_000)),
            exposure_lr: [exposure.learning_rate, exposure.final_learning_rate].map(|rate| factor * rate),
            poses_between: [
                config.poses.from.unwrap_or_else(|| scaled(500)),
                config.poses.until.unwrap_or(n_iterations).min(n_iterations),
            ],
            poses_lr: [config.poses.learning_rate, config.poses.final_learning_rate],
            transients_start: config.transients.from.unwrap_or_else(|| scaled(1_500)),
            stages: Stages::new(config, n_iterations, scaled),
        }
    }

    /// Multiplies all learning rates of Gaussians and network by `part`.
    pub fn slow_down(&mut self, part: f64) {
        let network = self.stages.as_mut().map(|stages| &mut stages.network_lr);
        let rates = [&mut self.mean_lr_initial, &mut self.mean_lr_final, &mut self.rate_factor];
        rates.into_iter().chain(network).for_each(|rate| *rate *= part);
    }

    /// Degree of the spherical harmonics in use: one more every `sh_interval`.
    pub fn sh_degree(&self, iteration: u32) -> u32 {
        (iteration / self.sh_interval.max(1)).min(self.max_sh_degree)
    }

    /// Learning rate of the means: log-linear from the first to the last rate, times the scene extent.
    pub fn mean_lr(&self, iteration: u32, extent: f64) -> f64 {
        let t = f64::from(iteration) / f64::from(self.mean_iterations.max(1));
        let (first, last) = (self.mean_lr_initial.ln(), self.mean_lr_final.ln());
        extent * (first + (last - first) * t.min(1.0)).exp()
    }

    /// Whether the photos' exposures are learned in this iteration, where they are.
    pub fn exposure_at(&self, iteration: u32) -> bool {
        iteration > self.exposure_start
    }

    /// Learning rate of the photos' exposures: log-linear from the first to the last.
    pub fn exposure_lr(&self, iteration: u32) -> f64 {
        log_linear(self.exposure_lr, self.progress(iteration))
    }

    /// Whether the training photos' cameras learn in this iteration, where they do.
    pub fn poses_at(&self, iteration: u32) -> bool {
        let [after, until] = self.poses_between;
        iteration > after && iteration <= until
    }

    /// Learning rate of the cameras, in radians: log-linear from the first, at the start of the run, to the last.
    pub fn poses_lr(&self, iteration: u32) -> f64 {
        let part = f64::from(iteration) / f64::from(self.poses_between[1].max(1));
        log_linear(self.poses_lr, part.min(1.0))
    }

    /// Whether the evidence of what moves is gathered in this iteration, where masks are learned.
    pub fn transients_at(&self, iteration: u32) -> bool {
        iteration > self.transients_start
    }

    /// Whether masks are made anew after this iteration, with so many training views: whenever each has been seen twice.
    pub fn masks_at(&self, iteration: u32, views: usize) -> bool {
        self.transients_at(iteration) && (iteration - self.transients_start).is_multiple_of(2 * views.max(1) as u32)
    }

    /// Part of the run that is done, 0 to 1.
    pub fn progress(&self, iteration: u32) -> f64 {
        f64::from(iteration) / f64::from(self.iterations.max(1))
    }

    /// Whether the model is evaluated after this iteration.
    pub fn evaluate_at(&self, iteration: u32) -> bool {
        iteration == self.iterations
            || self.eval_iterations.contains(&iteration)
            || (self.eval_every > 0 && iteration.is_multiple_of(self.eval_every))
    }

    /// Whether the model is saved after this iteration.
    pub fn save_at(&self, iteration: u32) -> bool {
        iteration == self.iterations || self.save_iterations.contains(&iteration)
    }
}

/// `reference * n / 30000`, rounded, at least 1.
fn scale(reference: u32, n: u32) -> u32 {
    let n = u64::from(n) * u64::from(reference);
    let half = u64::from(REFERENCE_ITERATIONS) / 2;
    let rounded = (n + half) / u64::from(REFERENCE_ITERATIONS);
    u32::try_from(rounded).unwrap_or(u32::MAX).max(1)
}

/// From the first to the last, evenly in the logarithm.
fn log_linear([first, last]: [f64; 2], progress: f64) -> f64 {
    (first.ln() + (last.ln() - first.ln()) * progress).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Strategy;

    pub(super) fn published() -> TrainConfig {
        let mut config = TrainConfig::default();
        config.densify.strategy = Strategy::Published;
        config
    }

    pub(super) fn schedule(n: u32) -> Schedule {
        Schedule::new(&published(), n)
    }

    pub(super) fn times(n: u32, event: impl Fn(u32) -> bool) -> Vec<u32> {
        (1..=n).filter(|&i| event(i)).collect()
    }

    #[test]
    fn reference_run() {
        let s = schedule(30_000);
        let rounds = times(30_000, |i| s.densify_at(i));
        assert_eq!(rounds.len(), 144);
        assert_eq!((rounds[0], rounds[1], rounds[143]), (600, 700, 14_900));
        assert_eq!(times(30_000, |i| s.reset_opacity_at(i)), [3_000, 6_000, 9_000, 12_000]);
        assert_eq!([999, 1_000, 1_999, 2_000, 3_000].map(|i| s.sh_degree(i)), [0, 1, 1, 2, 2]);
        assert_eq!(times(30_000, |i| s.evaluate_at(i)), [7_000, 30_000]);
        assert_eq!(times(30_000, |i| s.save_at(i)), [7_000, 30_000]);
        assert!(!s.prune_large(3_000) && s.prune_large(3_001));
        assert!(s.grows_at(14_999) && !s.grows_at(15_000));
    }

    #[test]
    fn rate_of_the_means_is_log_linear() {
        let s = schedule(30_000);
        for (i, expected) in [(0, 1.6e-4), (15_000, 1.6e-5), (30_000, 1.6e-6), (40_000, 1.6e-6)] {
            assert!((s.mean_lr(i, 2.0) / (2.0 * expected) - 1.0).abs() < 1e-12, "{i}");
        }
        let short = schedule(7_000);
        assert!((short.mean_lr(3_500, 1.0) / 1.6e-5 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_factor_slows_gaussians_and_rounds_but_not_the_network() {
        let of = |factor| {
            let mut config = TrainConfig::default();
            config.learning_rates.factor = factor;
            Schedule::new(&config, 30_000)
        };
        let (full, slow) = (of(None), of(Some(0.25)));
        let shares = [slow.mean_lr(9, 1.0) / full.mean_lr(9, 1.0), slow.exposure_lr(9) / full.exposure_lr(9)];
        assert!(shares.iter().all(|share| (share - 0.25).abs() < 1e-12), "{shares:?}");
        assert_eq!((slow.rate_factor, slow.densify_interval), (0.25, 800));
        assert_eq!((slow.network_lr(9), slow.densify_end), (full.network_lr(9), full.densify_end));
    }

    #[test]
    fn seven_thousand_keeps_start_and_interval_of_densification() {
        let s = schedule(7_000);
        let rounds = times(7_000, |i| s.densify_at(i));
        assert_eq!((rounds[0], rounds[1], *rounds.last().unwrap()), (600, 700, 3_400));
        assert_eq!(times(7_000, |i| s.reset_opacity_at(i)), [700, 1_400, 2_100, 2_800]);
        assert_eq!((s.sh_interval, s.mean_iterations, s.prune_large_after), (233, 7_000, 700));
        assert_eq!(times(7_000, |i| s.evaluate_at(i)), [1_633, 7_000]);
    }

    #[test]
    fn short_runs_scale_all_but_never_under_20() {
        let s = schedule(3_000);
        let rounds = times(3_000, |i| s.densify_at(i));
        assert_eq!((s.densify_start, s.densify_interval, s.densify_end), (50, 20, 1_500));
        assert_eq!((rounds[0], *rounds.last().unwrap()), (60, 1_480));
        assert_eq!(times(3_000, |i| s.reset_opacity_at(i)), [300, 600, 900, 1_200]);
        let s = schedule(500);
        let rounds = times(500, |i| s.densify_at(i));
        assert_eq!((s.densify_start, s.densify_interval, s.densify_end), (20, 20, 250));
        assert_eq!((rounds[0], *rounds.last().unwrap()), (40, 240));
        assert_eq!((s.sh_interval, s.opacity_reset_interval), (17, 50));
        let s = schedule(1);
        assert_eq!((s.sh_interval, s.densify_end, s.opacity_reset_interval), (1, 1, 1));
        assert!(s.evaluate_at(1) && s.save_at(1) && !s.densify_at(1) && !s.reset_opacity_at(1));
    }

    #[test]
    fn a_finished_model_has_a_short_schedule_without_densification() {
        let config = TrainConfig { init: Some("model.ply".into()), ..TrainConfig::default() };
        let s = Schedule::new(&config, 3_000);
        assert!(times(3_000, |i| s.densify_at(i) || s.reset_opacity_at(i)).is_empty());
        assert_eq!((s.sh_degree(1), s.sh_degree(2)), (1, 2));
        assert!((s.mean_lr(0, 1.0) / 1.6e-6 - 1.0).abs() < 1e-12 && s.rate_factor == 0.1);
        assert_eq!((s.surface_from(), s.residual_from()), (Some(151), Some(301)));
        assert!(s.burn_in(750).is_some() && s.burn_in(751).is_none());
        assert_eq!([1_799, 1_800, 2_549, 2_550].map(|i| s.network_lr(i)), [1e-3, 5e-4, 5e-4, 2.5e-4]);
    }

    #[test]
    fn absolute_milestones() {
        let mut config = TrainConfig { schedule_scaling: false, ..published() };
        let s = Schedule::new(&config, 3_000);
        let reference = schedule(30_000);
        // Cameras learn to the end.
        assert_eq!((s.poses_between, reference.poses_between), ([500, 3_000], [500, 30_000]));
        assert_eq!(Schedule { iterations: 30_000, poses_between: [500, 30_000], ..s }, reference);
        config.schedule_scaling = true;
        config.densify.start = Some(5);
        config.densify.end = Some(2_999);
        config.densify.interval = Some(7);
        config.densify.prune_scale_after = Some(11);
        config.opacity_reset.interval = Some(1_000);
        config.sh_interval = Some(10);
        config.learning_rates.mean_iterations = Some(99);
        config.eval_iterations = Some(vec![]);
        config.eval_every = 1_500;
        config.save_iterations = Some(vec![5]);
        let s = Schedule::new(&config, 3_000);
        assert_eq!((s.densify_start, s.densify_end, s.densify_interval), (5, 2_999, 7));
        assert_eq!((s.prune_large_after, s.sh_interval, s.mean_iterations), (11, 10, 99));
        assert_eq!(times(3_000, |i| s.reset_opacity_at(i)), [1_000, 2_000]);
        assert_eq!(times(3_000, |i| s.evaluate_at(i)), [1_500, 3_000]);
        assert_eq!(times(3_000, |i| s.save_at(i)), [5, 3_000]);
    }
}
