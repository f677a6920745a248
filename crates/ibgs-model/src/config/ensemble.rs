//! Ensembles: several bases, whose mean is the base image.

use super::check::Check;
use super::{ConfigError, Method, TrainConfig};

/// Most bases of an ensemble.
const MOST: u32 = 8;
/// Iterations of a further member, at most: its image needs no surface, and a base alone is about done.
const MEMBER_ITERATIONS: u32 = 7_000;
/// What the seeds of two members differ by.
const SEED_STEP: u64 = 0x9e37_79b9;

impl TrainConfig {
    /// The options of a further member of an ensemble, counted from 2: plain splatting with random numbers of its own.
    pub fn of_member(&self, number: u32) -> Self {
        let seed = self.seed.wrapping_add(SEED_STEP * u64::from(number - 1)) & i64::MAX as u64;
        let iterations = Some(self.iterations().min(MEMBER_ITERATIONS));
        Self { method: Method::Gs3, ensemble: 1, seed, iterations, schedule_scaling: true, ..self.clone() }
    }

    /// Checks the options of an ensemble.
    pub(super) fn check_ensemble(&self, check: &Check<'_>) -> Result<(), ConfigError> {
        let require = |holds, advice| check.require(holds, "ensemble", self.ensemble, advice);
        require((1..=MOST).contains(&self.ensemble), "it must lie between 1 and 8")?;
        let has_one = self.ensemble == 1 || self.init.is_none();
        require(has_one, "a training that begins with a model (`init`) has one base: it must be 1")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_differ_by_their_random_numbers() {
        let config =
            TrainConfig { ensemble: 3, iterations: Some(9_000), seed: u64::MAX >> 1, ..TrainConfig::default() };
        let members = [2, 3].map(|number| config.of_member(number));
        for member in &members {
            member.validate().unwrap();
            assert_eq!((member.ensemble, member.method, member.iterations()), (1, Method::Gs3, MEMBER_ITERATIONS));
        }
        assert!(members[0].seed != members[1].seed && members[0].seed != config.seed);
    }

    #[test]
    fn an_ensemble_has_bounds() {
        let message = |config: TrainConfig| config.validate().unwrap_err().to_string();
        assert!(message(TrainConfig { ensemble: 0, ..TrainConfig::default() }).contains("between 1 and 8"));
        let warm = TrainConfig { ensemble: 2, init: Some("a.ply".into()), ..TrainConfig::default() };
        assert!(message(warm).contains("`init`"));
    }
}
