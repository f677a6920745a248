//! Ensembles: several bases, whose mean is the base image.

use super::check::Check;
use super::{ConfigError, Method, PoseSwitch, Strategy, TrainConfig, TransientSwitch};

/// Most bases of an ensemble.
const MOST: u32 = 8;
/// Bases where none are asked for.
const USUAL: u32 = 2;
/// Iterations of a further member that is no chain of MCMC, at most: its image needs no surface, and a base alone is about done.
const MEMBER_ITERATIONS: u32 = 7_000;
/// What the seeds of two members differ by.
const SEED_STEP: u64 = 0x9e37_79b9;

impl TrainConfig {
    /// Number of bases. Where none is given and [`adapt_to_photos`](Self::adapt_to_photos) was not called, a single one.
    pub fn ensemble(&self) -> u32 {
        self.ensemble.unwrap_or(1)
    }

    /// Number of members that have the weight of the first: those with a network, or all where none has one.
    pub fn weighted_as_the_first(&self) -> usize {
        let count = if self.method == Method::Ibgs { self.residual.networks } else { self.ensemble() };
        count as usize
    }

    /// Number of bases where none is given. Photos with alpha are mostly rendered: hardly anything in them is chance, and a longer
    /// run gains more.
    pub fn usual_ensemble(&self) -> u32 {
        let is_usual = self.method == Method::Ibgs && self.densify.strategy == Strategy::Default;
        if is_usual && self.init.is_none() && !self.data.has_alpha() { USUAL } else { 1 }
    }

    /// The options of a further member of an ensemble, counted from 2, with random numbers of its own: a training like the first,
    /// or plain splatting by the same strategy and by MCMC in turn; of an object by MCMC first, as what the strategy gets wrong on
    /// one is hardly chance.
    pub fn of_member(&self, number: u32) -> Self {
        let seed = self.seed.wrapping_add(SEED_STEP * u64::from(number - 1)) & i64::MAX as u64;
        let mut like_the_first = Self { seed, ..self.single() };
        // It has the cameras and the masks of the first.
        like_the_first.poses.refine = PoseSwitch::Off;
        like_the_first.transients.mask = TransientSwitch::Off;
        let Some(plain) = number.checked_sub(self.residual.networks + 1) else { return like_the_first };
        let mut member = Self { method: Method::Gs3, schedule_scaling: true, ..like_the_first };
        member.learning_rates.factor = None;
        let is_chain = (plain % 2 == 1) != self.data.shows_object();
        if is_chain {
            member.densify.strategy = Strategy::Mcmc;
        }
        let iterations = self.iterations();
        member.iterations = Some(if is_chain { iterations } else { iterations.min(MEMBER_ITERATIONS) });
        member
    }

    /// Those of its first member alone.
    pub(crate) fn single(&self) -> Self {
        let mut config = Self { ensemble: Some(1), ..self.clone() };
        config.residual.networks = 1;
        config
    }

    /// Checks the options of an ensemble.
    pub(super) fn check_ensemble(&self, check: &Check<'_>) -> Result<(), ConfigError> {
        let (count, networks) = (self.ensemble(), self.residual.networks);
        let require = |holds, advice| check.require(holds, "ensemble", count, advice);
        require((1..=MOST).contains(&count), "it must lie between 1 and 8")?;
        let has_one = count == 1 || self.init.is_none();
        require(has_one, "a training that begins with a model (`init`) has one base: it must be 1")?;
        let fits = networks == 1 || (1..=count).contains(&networks);
        check.require(fits, "residual.networks", networks, "it must lie between 1 and `ensemble`")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ensemble(count: u32, networks: u32) -> TrainConfig {
        let mut config = TrainConfig { ensemble: Some(count), iterations: Some(9_000), ..TrainConfig::default() };
        config.residual.networks = networks;
        config
    }

    #[test]
    fn members_differ_by_their_random_numbers_and_ways() {
        let config = TrainConfig { seed: u64::MAX >> 1, ..ensemble(6, 2) };
        let members = [2, 3, 4, 5, 6].map(|number| config.of_member(number));
        let kinds = [
            (Method::Ibgs, Strategy::Default, 9_000),
            (Method::Gs3, Strategy::Default, MEMBER_ITERATIONS),
            (Method::Gs3, Strategy::Mcmc, 9_000),
            (Method::Gs3, Strategy::Default, MEMBER_ITERATIONS),
            (Method::Gs3, Strategy::Mcmc, 9_000),
        ];
        for (member, kind) in members.iter().zip(kinds) {
            member.validate().unwrap();
            assert_eq!((member.method, member.densify.strategy, member.iterations()), kind);
            assert_eq!(member.ensemble, Some(1));
        }
        let mut seeds = members.map(|member| member.seed).to_vec();
        seeds.push(config.seed);
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 6);
    }

    #[test]
    fn an_object_has_a_chain_first() {
        let of_object = |count, networks| {
            let mut config = ensemble(count, networks);
            config.data.masks = Some(crate::dataset::Masks::Object);
            config
        };
        let kind = |config: &TrainConfig, number| {
            let member = config.of_member(number);
            (member.densify.strategy, member.iterations())
        };
        assert_eq!(kind(&of_object(2, 1), 2), (Strategy::Mcmc, 9_000));
        assert_eq!(kind(&ensemble(2, 1), 2), (Strategy::Default, MEMBER_ITERATIONS));
        let best = of_object(6, 2);
        let kinds = [3, 4, 5, 6].map(|number| kind(&best, number));
        let (chain, plain) = ((Strategy::Mcmc, 9_000), (Strategy::Default, MEMBER_ITERATIONS));
        assert_eq!(kinds, [chain, plain, chain, plain]);
    }

    #[test]
    fn an_ensemble_has_bounds() {
        let message = |config: TrainConfig| config.validate().unwrap_err().to_string();
        assert!(message(ensemble(0, 1)).contains("between 1 and 8"));
        let warm = TrainConfig { init: Some("a.ply".into()), ..ensemble(2, 1) };
        assert!(message(warm).contains("`init`"));
        for wrong in [ensemble(2, 3), ensemble(2, 0)] {
            assert!(message(wrong).contains("`residual.networks`"));
        }
    }

    #[test]
    fn only_the_usual_run_has_two_bases_unasked() {
        let count = |mut config: TrainConfig| {
            config.adapt_to_photos(50, 1);
            config.ensemble()
        };
        let mut chain = TrainConfig::default();
        chain.densify.strategy = Strategy::Mcmc;
        let mut object = TrainConfig::default();
        object.data.masks = Some(crate::dataset::Masks::Object);
        let mut with_alpha = TrainConfig::default();
        with_alpha.data.alpha = Some(crate::dataset::Alpha::Composite);
        let plain = TrainConfig { method: Method::Gs3, ..TrainConfig::default() };
        let warm = TrainConfig { init: Some("a.ply".into()), ..TrainConfig::default() };
        assert_eq!([chain, with_alpha, plain, warm, ensemble(1, 1)].map(count), [1; 5]);
        assert_eq!([TrainConfig::default(), object, ensemble(6, 2)].map(count), [2, 2, 6]);
    }
}
