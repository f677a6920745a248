//! When rounds of densification and opacity resets come, and what a round may do (method.md section 7).

use super::Schedule;

/// Iterations without pruning by opacity after an opacity reset: from 0.01 Adam needs 66 steps of 0.025 in the logit to
/// reach the pruning threshold of 0.05, so rounds that follow sooner would remove every Gaussian. In the reference
/// schedule the first round comes after 100 iterations and nothing changes; short runs have rounds every 20.
const RESET_RECOVERY: u32 = 100;

impl Schedule {
    /// Whether a round of densification and pruning follows this iteration.
    pub fn densify_at(&self, iteration: u32) -> bool {
        iteration > self.densify_start
            && iteration < self.rounds_end
            && iteration.is_multiple_of(self.densify_interval.max(1))
    }

    /// Whether a round at or after this iteration may add Gaussians, so that their gradients count.
    pub fn grows_at(&self, iteration: u32) -> bool {
        iteration < self.densify_end
    }

    /// Rounds from this one on, included, in the first half of the run.
    pub fn rounds_until_half(&self, iteration: u32) -> u32 {
        let half = self.iterations / 2;
        if iteration <= half { (half - iteration) / self.densify_interval.max(1) + 1 } else { 0 }
    }

    /// Whether opacities are reset after this iteration, with a strategy that resets them; never once densification has ended.
    pub fn reset_opacity_at(&self, iteration: u32) -> bool {
        let regular = iteration > 0 && iteration.is_multiple_of(self.opacity_reset_interval.max(1));
        self.resets_opacity && iteration < self.densify_end && (regular || self.white_reset == Some(iteration))
    }

    /// Whether a round at this iteration prunes large Gaussians too.
    pub fn prune_large(&self, iteration: u32) -> bool {
        iteration > self.prune_large_after
    }

    /// Whether a round at this iteration prunes by opacity: not within 100 iterations after a reset. The published code
    /// needs no such rule.
    pub fn prune_transparent(&self, iteration: u32) -> bool {
        let interval = self.opacity_reset_interval.max(1);
        // A reset at `iteration` itself comes after its round.
        let before = iteration.min(self.densify_end).saturating_sub(1);
        let regular = (before / interval) * interval;
        let white = self.white_reset.filter(|&reset| reset <= before).unwrap_or(0);
        let last = regular.max(white);
        last == 0 || iteration - last >= RESET_RECOVERY
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{published, schedule, times};
    use super::*;
    use crate::config::{Background, Strategy, TrainConfig};

    #[test]
    fn rounds_soon_after_a_reset_do_not_prune_by_opacity() {
        let s = schedule(30_000);
        let kept = |s: &Schedule, n| times(n, |i| s.densify_at(i) && !s.prune_transparent(i));
        assert!(kept(&s, 30_000).is_empty());
        let s = schedule(3_000);
        assert_eq!(kept(&s, 3_000)[..5], [320, 340, 360, 380, 620]);
        assert!(s.prune_transparent(300) && s.prune_transparent(400));
        let white = TrainConfig { background: Some(Background::WHITE), ..published() };
        assert!(kept(&Schedule::new(&white, 30_000), 30_000).is_empty());
        assert_eq!(kept(&Schedule::new(&white, 3_000), 3_000)[..5], [60, 80, 100, 120, 140]);
    }

    #[test]
    fn the_default_has_rounds_to_the_end_and_resets_nothing() {
        let config = TrainConfig { background: Some(Background::WHITE), ..TrainConfig::default() };
        let s = Schedule::new(&config, 30_000);
        assert!(times(30_000, |i| s.reset_opacity_at(i)).is_empty());
        let rounds = times(30_000, |i| s.densify_at(i));
        assert_eq!((rounds[0], rounds[1], *rounds.last().unwrap()), (600, 800, 29_800));
        assert_eq!(rounds.into_iter().rfind(|&i| s.grows_at(i)), Some(20_800));
        assert!(s.grows_at(20_999) && !s.grows_at(21_000));
        assert_eq!((s.progress(0), s.progress(15_000)), (0.0, 0.5));
        let short = Schedule::new(&config, 2_000);
        let rounds = times(2_000, |i| short.densify_at(i));
        assert_eq!((short.densify_start, rounds[0], rounds[1]), (250, 300, 400));
        assert_eq!(rounds.into_iter().rfind(|&i| short.grows_at(i)), Some(1_300));
        let warm = TrainConfig { init: Some("model.ply".into()), ..TrainConfig::default() };
        assert!(times(3_000, |i| Schedule::new(&warm, 3_000).densify_at(i)).is_empty());
    }

    #[test]
    fn mcmc_goes_on_longer_and_resets_nothing() {
        let mut config = TrainConfig { background: Some(Background::WHITE), ..TrainConfig::default() };
        config.densify.strategy = Strategy::Mcmc;
        let s = Schedule::new(&config, 30_000);
        assert!(times(30_000, |i| s.reset_opacity_at(i)).is_empty());
        assert_eq!(times(30_000, |i| s.densify_at(i)).last(), Some(&24_900));
        assert_eq!((config.densify.most(), config.start()), (1_000_000, [0.5, 0.1]));
    }

    #[test]
    fn white_background_resets_once_more() {
        let config = TrainConfig { background: Some(Background::WHITE), ..published() };
        let s = Schedule::new(&config, 30_000);
        assert_eq!(times(30_000, |i| s.reset_opacity_at(i)), [500, 3_000, 6_000, 9_000, 12_000]);
    }
}
