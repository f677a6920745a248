//! Options that follow from the training photos.

use super::schedule::REFERENCE_ITERATIONS;
use super::{Background, DensifyConfig, Method, TrainConfig};
use crate::dataset::Dataset;
use std::fmt;

/// Iterations of the default strategy at full rates.
const ITERATIONS_AT_FULL_RATES: f64 = 7_000.0;
/// Visits of each photo at full rates, if these take more iterations: 163 visits of 43 photos are 7000 iterations.
const VISITS_AT_FULL_RATES: f64 = 163.0;

/// Most visits of each photo with the residual: a network that sees each photo more often learns them by heart.
const VISITS_WITH_RESIDUAL: u32 = 250;

/// Length of a run of the default strategy.
struct Length {
    /// Visits of each photo.
    visits: u32,
    least: u32,
    most: u32,
}

/// That of most runs.
const USUAL_LENGTH: Length = Length { visits: 200, least: 7_000, most: REFERENCE_ITERATIONS };
/// That of two bases, but for photos with alpha: what the first one has in fewer iterations, the mean makes good in half of the time.
const LENGTH_OF_TWO: Length = Length { visits: 130, least: 5_000, most: 11_000 };

/// Why a training has its number of iterations, where nobody asked for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LengthReason {
    /// So many visits of each photo.
    Visits(u32),
    /// So many visits would be too few iterations.
    Least(u32),
    /// So many visits would be too many iterations.
    Most(u32),
    /// It does not follow the photos: the strategy's own length, or that of a start from a model.
    Own,
}

impl fmt::Display for LengthReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Visits(visits) => write!(f, "{visits} visits of each photo"),
            Self::Least(visits) => write!(f, "the least of such runs, more than {visits} visits of each photo"),
            Self::Most(visits) => write!(f, "the most of such runs, fewer than {visits} visits of each photo"),
            Self::Own => f.write_str("the length of such runs, whatever the number of photos"),
        }
    }
}

impl DensifyConfig {
    /// Sets the cap on Gaussians from the scene, for the strategies that do so, unless it is given: one Gaussian per 45
    /// pixels of the training photos, at least 200,000 and at most 3 million. MCMC grows to it.
    fn choose_cap(&mut self, pixels: u64) {
        if self.strategy.defaults().cap_follows_photos && self.max_splats.is_none() {
            self.max_splats = Some((pixels / 45).clamp(200_000, 3_000_000) as u32);
        }
    }
}

impl TrainConfig {
    /// Sets the options that depend on the scene, unless they are given: those of [`adapt_to_object`](Self::adapt_to_object) and of
    /// [`adapt_to_photos`](Self::adapt_to_photos).
    pub fn adapt_to(&mut self, dataset: &Dataset) {
        self.adapt_to_object(dataset);
        let pixels = dataset.train.iter().map(|&view| dataset.views[view].camera.pixels() as u64).sum();
        self.adapt_to_photos(dataset.train.len(), pixels);
    }

    /// Sets what the photos' alpha and masks mean, and the background, unless they are given.
    pub fn adapt_to_object(&mut self, dataset: &Dataset) {
        self.data.masks.get_or_insert(dataset.masks);
        if let Some((alpha, color)) = dataset.backdrop {
            self.data.alpha = self.data.alpha.or(alpha.is_cover().then_some(alpha));
            self.background.get_or_insert(Background::Color(color));
        }
    }

    /// Sets the options that depend on the training photos, unless they are given: the number of bases and of iterations, the cap
    /// on Gaussians and the factor on their learning rates. `pixels` counts those of all training photos.
    ///
    /// With the default strategy and `schedule_scaling` a run of two bases visits every photo 130 times, in 5000 iterations at
    /// least and 11,000 at most, any other 200 times, in 7000 to 30,000. At full rates it overfits after 7000 iterations or 163
    /// visits of each photo, whichever is more. In a longer run the rates fall, and the rounds of densification move apart, in
    /// proportion, so that the Gaussians move as far as in that many iterations. Departures from method.md.
    pub fn adapt_to_photos(&mut self, photos: usize, pixels: u64) {
        self.densify.choose_cap(pixels);
        self.ensemble.get_or_insert(self.usual_ensemble());
        let (usual, _) = self.usual_length(photos);
        self.iterations.get_or_insert(usual);
        if self.length_follows_photos() && self.learning_rates.factor.is_none() {
            let full = ITERATIONS_AT_FULL_RATES.max(VISITS_AT_FULL_RATES * photos as f64);
            self.learning_rates.factor = Some((full / f64::from(self.iterations())).min(1.0));
        }
        self.delay_residual(photos);
    }

    /// Lets the residual of a long run on few photos begin later, unless its milestones are given. What belongs to it keeps its
    /// place in what is left: the burn-in takes 15 %, the network's rate is halved after 40 and 75 %.
    fn delay_residual(&mut self, photos: usize) {
        let residual = &self.residual;
        let is_given = residual.start.is_some() || residual.burn_in.is_some() || residual.halve_at.is_some();
        let has_usual_stages = self.method == Method::Ibgs && self.schedule_scaling && residual.init.is_none();
        if is_given || !has_usual_stages || !self.length_follows_photos() {
            return;
        }
        let iterations = self.iterations();
        let most = u32::try_from(photos).unwrap_or(u32::MAX).saturating_mul(VISITS_WITH_RESIDUAL);
        let start = iterations.saturating_sub(most);
        if most > 0 && start > iterations / 3 {
            let after = |percent: u32| (u64::from(most) * u64::from(percent) / 100) as u32;
            self.residual.start = Some(start);
            self.residual.burn_in = Some(after(15));
            self.residual.halve_at = Some(vec![start + after(40), start + after(75)]);
        }
    }

    fn length_follows_photos(&self) -> bool {
        self.densify.strategy.defaults().length_follows_photos && self.init.is_none()
    }

    /// Iterations of a run of so many photos where none are given, once the number of bases is known.
    fn usual_length(&self, photos: usize) -> (u32, LengthReason) {
        let is_of_two = self.ensemble() == 2 && !self.data.has_alpha();
        let Length { visits, least, most } = if is_of_two { LENGTH_OF_TWO } else { USUAL_LENGTH };
        // Milestones that are not scaled need the whole length.
        if !(self.length_follows_photos() && self.schedule_scaling) {
            return (Self { iterations: None, ..self.clone() }.iterations(), LengthReason::Own);
        }
        let wanted = u32::try_from(photos).unwrap_or(most).saturating_mul(visits);
        let reason = match wanted.clamp(least, most) {
            length if length > wanted => LengthReason::Least(visits),
            length if length < wanted => LengthReason::Most(visits),
            _ => LengthReason::Visits(visits),
        };
        (wanted.clamp(least, most), reason)
    }

    /// Why a run with these options, adapted to so many photos, has its length; none where another one was asked for.
    pub fn length_reason(&self, photos: usize) -> Option<LengthReason> {
        let (usual, reason) = self.usual_length(photos);
        (self.iterations() == usual).then_some(reason)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Strategy;

    #[test]
    fn the_cap_follows_the_photos() {
        let cap = |strategy, pixels| {
            let mut densify = DensifyConfig { strategy, ..DensifyConfig::default() };
            densify.choose_cap(pixels);
            densify.most()
        };
        for strategy in [Strategy::Default, Strategy::Mcmc] {
            assert_eq!([1, 45_000_000, u64::MAX].map(|p| cap(strategy, p)), [200_000, 1_000_000, 3_000_000]);
        }
        assert_eq!(cap(Strategy::Published, 1), 5_000_000);
        let mut given = DensifyConfig { max_splats: Some(7), ..DensifyConfig::default() };
        given.choose_cap(45_000_000);
        assert_eq!(given.most(), 7);
    }

    #[test]
    fn the_length_follows_the_photos() {
        let length = |photos, mut config: TrainConfig| {
            config.adapt_to_photos(photos, 1);
            config.iterations()
        };
        let single = || TrainConfig { ensemble: Some(1), ..TrainConfig::default() };
        let lengths = [1, 43, 70, 150, usize::MAX].map(|photos| length(photos, single()));
        assert_eq!(lengths, [7_000, 8_600, 14_000, 30_000, 30_000]);
        let lengths = [1, 43, 70, 150, usize::MAX].map(|photos| length(photos, TrainConfig::default()));
        assert_eq!(lengths, [5_000, 5_590, 9_100, 11_000, 11_000]);
        let mut with_alpha = TrainConfig { ensemble: Some(2), ..TrainConfig::default() };
        with_alpha.data.alpha = Some(crate::dataset::Alpha::Composite);
        assert_eq!([43, 100].map(|photos| length(photos, with_alpha.clone())), [8_600, 20_000]);
        let reason = |photos| {
            let mut config = single();
            config.adapt_to_photos(photos, 1);
            config.length_reason(photos)
        };
        let reasons = [1, 43, 35, 151].map(reason);
        let expected =
            [LengthReason::Least(200), LengthReason::Visits(200), LengthReason::Visits(200), LengthReason::Most(200)];
        assert_eq!(reasons, expected.map(Some));
        let given = TrainConfig { iterations: Some(5), ..TrainConfig::default() };
        assert_eq!(given.length_reason(43), None);
        let warm = TrainConfig { init: Some("scene.ply".into()), ..TrainConfig::default() };
        let mut published = TrainConfig::default();
        published.densify.strategy = Strategy::Published;
        let unscaled = TrainConfig { schedule_scaling: false, ..TrainConfig::default() };
        let lengths = [given, warm, published, unscaled].map(|config| length(43, config));
        assert_eq!(lengths, [5, 3_000, 30_000, 30_000]);
    }

    #[test]
    fn the_residual_of_a_long_run_on_few_photos_begins_late() {
        let start = |iterations, photos, mut config: TrainConfig| {
            config.iterations = Some(iterations);
            config.adapt_to_photos(photos, 1);
            config.residual
        };
        let default = TrainConfig::default;
        for (iterations, photos) in [(5_000, 17), (9_100, 70), (30_000, 100), (7_000, 0)] {
            assert_eq!(start(iterations, photos, default()), default().residual, "{iterations} of {photos}");
        }
        let late = start(30_000, 17, default());
        assert_eq!((late.start, late.burn_in), (Some(25_750), Some(637)));
        assert_eq!(late.halve_at, Some(vec![27_450, 28_937]));
        let mut given = default();
        given.residual.burn_in = Some(5);
        let warm = TrainConfig { init: Some("scene.ply".into()), ..default() };
        let unscaled = TrainConfig { schedule_scaling: false, ..default() };
        let mut published = default();
        published.densify.strategy = Strategy::Published;
        for config in [given, warm, unscaled, published] {
            assert_eq!(start(30_000, 17, config.clone()), config.residual);
        }
    }

    #[test]
    fn long_runs_of_the_default_strategy_learn_slowly() {
        let factor = |iterations, photos, config: TrainConfig| {
            let mut config = TrainConfig { iterations: Some(iterations), ..config };
            config.adapt_to_photos(photos, 1);
            config.learning_rates.factor
        };
        let runs = [(7_000, 17), (7_000, 200), (14_000, 17), (30_000, 43), (30_000, 100), (30_000, 1_000)];
        let chosen = runs.map(|(iterations, photos)| factor(iterations, photos, TrainConfig::default()));
        let expected = [1.0, 1.0, 0.5, 7_009.0 / 30_000.0, 16_300.0 / 30_000.0, 1.0];
        assert_eq!(chosen, expected.map(Some));
        let mut published = TrainConfig::default();
        published.densify.strategy = Strategy::Published;
        let warm = TrainConfig { init: Some("scene.ply".into()), ..TrainConfig::default() };
        let mut given = TrainConfig::default();
        given.learning_rates.factor = Some(0.7);
        assert_eq!([published, warm, given].map(|config| factor(30_000, 43, config)), [None, None, Some(0.7)]);
    }
}
