//! When the image-based stages begin and how they change (method.md sections 6 and 7).

use super::Schedule;
use crate::config::{Method, TrainConfig};

/// Milestones of the image-based stages, as absolute iterations.
#[derive(Clone, Debug, PartialEq)]
pub struct Stages {
    /// Surface losses come after this iteration.
    pub surface_start: u32,
    /// The normal loss comes after this iteration.
    pub normal_start: u32,
    /// The residual comes after this iteration.
    pub residual_start: u32,
    /// Iterations of the residual in which only the network learns.
    pub burn_in: u32,
    /// Gain of the base image when the burn-in begins.
    pub burn_in_gain: f64,
    /// Learning rate of the network at first.
    pub network_lr: f64,
    /// Iterations at which it is halved.
    pub halve_at: Vec<u32>,
}

impl Stages {
    /// The milestones of `config`, unset ones by `scaled`; none for a method that has no such stages.
    ///
    /// A run that begins with a finished model has its own, as parts of the run: surface losses from 5 % on, the residual
    /// from 10 %, burn-in until 25 %, rates halved at 60 % and 85 %.
    pub(super) fn new(config: &TrainConfig, iterations: u32, reference: impl Fn(u32) -> u32) -> Option<Self> {
        let warm = |milestone: u32| match milestone {
            7_000 => iterations / 20,
            10_000 => iterations / 10,
            3_000 => iterations * 3 / 20,
            18_000 => iterations * 3 / 5,
            25_000 => iterations * 17 / 20,
            other => reference(other),
        };
        let scaled = |milestone: u32| if config.init.is_some() { warm(milestone) } else { reference(milestone) };
        if config.method != Method::Ibgs {
            return None;
        }
        let (surface, residual) = (&config.surface, &config.residual);
        let surface_start = surface.start.unwrap_or_else(|| scaled(7_000));
        let halve_at = residual.halve_at.clone();
        let usual_burn_in = || if residual.init.is_some() { 0 } else { scaled(3_000) };
        Some(Self {
            surface_start,
            normal_start: surface.normal_from.unwrap_or(surface_start).max(surface_start),
            residual_start: residual.start.unwrap_or_else(|| scaled(10_000)),
            burn_in: residual.burn_in.unwrap_or_else(usual_burn_in),
            burn_in_gain: residual.burn_in_gain,
            network_lr: residual.learning_rate,
            halve_at: halve_at.unwrap_or_else(|| vec![scaled(18_000), scaled(25_000)]),
        })
    }
}

impl Schedule {
    /// First iteration with surface losses; none for a method without.
    pub fn surface_from(&self) -> Option<u32> {
        self.stages.as_ref().map(|stages| stages.surface_start + 1)
    }

    /// First iteration with the residual; none for a method without.
    pub fn residual_from(&self) -> Option<u32> {
        self.stages.as_ref().map(|stages| stages.residual_start + 1)
    }

    /// Whether the photometric loss, and with it the surface, counts in this iteration.
    pub fn surface_loss_at(&self, iteration: u32) -> bool {
        self.stages.as_ref().is_some_and(|stages| iteration > stages.surface_start)
    }

    /// Whether the normal loss counts in this iteration.
    pub fn normal_loss_at(&self, iteration: u32) -> bool {
        self.stages.as_ref().is_some_and(|stages| iteration > stages.normal_start)
    }

    /// Whether the final image with its residual is made in this iteration.
    pub fn residual_at(&self, iteration: u32) -> bool {
        self.stages.as_ref().is_some_and(|stages| iteration > stages.residual_start)
    }

    /// Gain of the base image in the final one while only the network learns from it: linear up to 1 in the last iteration of
    /// the burn-in. None before and after it.
    pub fn burn_in(&self, iteration: u32) -> Option<f64> {
        let stages = self.stages.as_ref()?;
        let done = iteration.checked_sub(stages.residual_start).filter(|&done| 0 < done && done <= stages.burn_in)?;
        let t = f64::from(done) / f64::from(stages.burn_in);
        Some(stages.burn_in_gain + (1.0 - stages.burn_in_gain) * t)
    }

    /// Learning rate of the network: halved at each milestone; 0 for a method without one.
    pub fn network_lr(&self, iteration: u32) -> f64 {
        let Some(stages) = &self.stages else {
            return 0.0;
        };
        let halvings = stages.halve_at.iter().filter(|&&at| iteration >= at).count();
        stages.network_lr * 0.5f64.powi(halvings as i32)
    }

    /// First iteration whose median depths are kept for later use as a source: so early that every one of `views` training
    /// views has come up by the time that its depth is read. At its start the plane normals become the shortest axes
    /// (a departure from the published code, method.md 10.7). None for a method without.
    pub fn depth_cache_from(&self, views: usize) -> Option<u32> {
        let stages = self.stages.as_ref()?;
        let first = stages.surface_start.min(stages.residual_start);
        let lead = u32::try_from(views.saturating_mul(2)).unwrap_or(u32::MAX);
        Some(first.saturating_sub(lead).max(1))
    }

    /// Whether the median depths of this iteration are kept.
    pub fn keeps_depth_at(&self, iteration: u32, views: usize) -> bool {
        self.depth_cache_from(views).is_some_and(|first| iteration >= first)
    }

    /// Whether the plane normals are set to the Gaussians' shortest axes before this iteration.
    pub fn shapes_normals_at(&self, iteration: u32, views: usize) -> bool {
        self.depth_cache_from(views) == Some(iteration)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first(n: u32, event: impl Fn(u32) -> bool) -> Option<u32> {
        (1..=n).find(|&i| event(i))
    }

    #[test]
    fn reference_run() {
        let s = Schedule::new(&TrainConfig::default(), 30_000);
        assert_eq!((s.surface_from(), s.residual_from()), (Some(7_001), Some(10_001)));
        assert_eq!(first(30_000, |i| s.surface_loss_at(i)), Some(7_001));
        assert_eq!(first(30_000, |i| s.normal_loss_at(i)), Some(7_001));
        assert_eq!(first(30_000, |i| s.residual_at(i)), Some(10_001));
        assert_eq!(first(30_000, |i| s.residual_at(i) && s.burn_in(i).is_none()), Some(13_001));
        assert!((1..=10_000).all(|i| s.burn_in(i).is_none()));
        assert!((10_001..=13_000).all(|i| s.burn_in(i) == Some(1.0)));
        let mut published = TrainConfig::default();
        published.residual.burn_in_gain = 0.5;
        let rising = Schedule::new(&published, 30_000);
        for (i, gain) in [(10_001, 0.5 + 0.5 / 3_000.0), (11_500, 0.75), (13_000, 1.0)] {
            assert!((rising.burn_in(i).unwrap() - gain).abs() < 1e-12, "{i}");
        }
        let rates = [10_001, 17_999, 18_000, 24_999, 25_000, 30_000].map(|i| s.network_lr(i));
        assert_eq!(rates, [1e-3, 1e-3, 5e-4, 5e-4, 2.5e-4, 2.5e-4]);
        assert_eq!(s.depth_cache_from(43), Some(6_914));
        assert_eq!(first(30_000, |i| s.keeps_depth_at(i, 43)), Some(6_914));
        assert_eq!((1..=30_000).filter(|&i| s.shapes_normals_at(i, 43)).collect::<Vec<_>>(), [6_914]);
        assert_eq!(s.depth_cache_from(5_000), Some(1));
        assert_eq!(first(30_000, |i| s.exposure_at(i)), Some(1_001));
    }

    #[test]
    fn milestones_follow_the_length_and_the_options() {
        let mut config = TrainConfig::default();
        let s = Schedule::new(&config, 3_000);
        assert_eq!((s.surface_from(), s.residual_from()), (Some(701), Some(1_001)));
        assert_eq!(first(3_000, |i| s.residual_at(i) && s.burn_in(i).is_none()), Some(1_301));
        assert_eq!([1_799, 1_800, 2_500].map(|i| s.network_lr(i)), [1e-3, 5e-4, 2.5e-4]);
        assert_eq!((first(3_000, |i| s.exposure_at(i)), s.depth_cache_from(40)), (Some(101), Some(620)));
        config.surface.start = Some(50);
        config.surface.normal_from = Some(70);
        config.residual.start = Some(40);
        config.residual.burn_in = Some(0);
        config.residual.halve_at = Some(vec![]);
        config.exposure.from = Some(3);
        let s = Schedule::new(&config, 3_000);
        assert_eq!((s.surface_from(), s.residual_from(), s.depth_cache_from(10)), (Some(51), Some(41), Some(20)));
        assert_eq!((first(99, |i| s.normal_loss_at(i)), first(99, |i| s.exposure_at(i))), (Some(71), Some(4)));
        assert!((1..=3_000).all(|i| s.burn_in(i).is_none() && s.network_lr(i) == 1e-3));
        // A network that is trained already.
        let mut trained = TrainConfig::default();
        trained.residual.init = Some("network.safetensors".into());
        assert!((1..=3_000).all(|i| Schedule::new(&trained, 3_000).burn_in(i).is_none()));
        // The shortest of runs.
        let s = Schedule::new(&TrainConfig::default(), 1);
        assert!(!s.surface_loss_at(1) && !s.residual_at(1) && s.shapes_normals_at(1, 8));
    }

    #[test]
    fn plain_splatting_has_no_stages() {
        let s = Schedule::new(&TrainConfig { method: Method::Gs3, ..TrainConfig::default() }, 30_000);
        let any = |i| s.surface_loss_at(i) || s.normal_loss_at(i) || s.residual_at(i) || s.keeps_depth_at(i, 9);
        assert!((1..=30_000).all(|i| !any(i) && s.burn_in(i).is_none() && s.network_lr(i) == 0.0));
    }
}
