//! Steps of Adam of a camera, as long as the gradients of its visits agree.

use serde::{Deserialize, Serialize};

/// Adam's decays, and what is added to the root of the second moment.
const BETA: [f64; 2] = [0.9, 0.99];
const EPSILON: f64 = 1e-15;
/// Numbers of a pose.
const POSE: usize = 6;

/// A step of Adam in the making, of a pose or of a lens, which has two numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Moments {
    first: [f64; POSE],
    second: [f64; POSE],
    pub steps: i32,
    gathered: [f64; POSE],
    /// Targets that have been gathered.
    pub targets: usize,
}

impl Moments {
    pub fn gather(&mut self, gradient: [f64; POSE], is_target: bool) {
        self.gathered.iter_mut().zip(gradient).for_each(|(sum, v)| *sum += v);
        self.targets += usize::from(is_target);
    }

    /// The step by what has been gathered, in units of the numbers; times the agreement to the power of `strictness`.
    pub fn step(&mut self, rate: f64, strictness: f64) -> [f64; POSE] {
        let gradient = std::mem::take(&mut self.gathered);
        self.targets = 0;
        self.steps += 1;
        for (i, v) in gradient.into_iter().enumerate() {
            self.first[i] = BETA[0] * self.first[i] + (1.0 - BETA[0]) * v;
            self.second[i] = BETA[1] * self.second[i] + (1.0 - BETA[1]) * v.powi(2);
        }
        let rate = rate * self.agreement().powf(strictness);
        let [left1, left2] = self.unbiased();
        std::array::from_fn(|i| -rate * (self.first[i] / left1) / ((self.second[i] / left2).sqrt() + EPSILON))
    }

    /// What Adam's moments are divided by.
    fn unbiased(&self) -> [f64; 2] {
        BETA.map(|beta| 1.0 - beta.powi(self.steps))
    }

    /// How far the gradients of the last visits agree, from 0 to 1: the length of their mean beside the root of their mean square, less
    /// what it is by chance. One visit agrees with nothing.
    fn agreement(&self) -> f64 {
        let [left1, left2] = self.unbiased();
        let mean: f64 = self.first.iter().map(|v| (v / left1).powi(2)).sum();
        let square: f64 = self.second.iter().map(|v| v / left2).sum();
        if self.steps < 2 || square <= 0.0 {
            return 0.0;
        }
        // The mean square of the weighted mean of gradients that are all chance, as a part of theirs.
        let chance = (1.0 - BETA[0]) / (1.0 + BETA[0]) * (2.0 - left1) / left1;
        ((mean / square - chance) / (1.0 - chance)).clamp(0.0, 1.0).sqrt()
    }

    pub fn is_finite(&self) -> bool {
        [self.first, self.second, self.gathered].as_flattened().iter().all(|v| v.is_finite())
    }
}

/// Takes the mean first moment back, which would move all cameras alike again.
pub fn level(poses: &mut [Moments]) {
    let count = poses.len().max(1) as f64;
    for i in 0..POSE {
        let mean = poses.iter().map(|moments| moments.first[i]).sum::<f64>() / count;
        poses.iter_mut().for_each(|moments| moments.first[i] -= mean);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera's visits with these gradients; the last step of a rate of one.
    fn stepped(gradients: impl Iterator<Item = [f64; POSE]>, strictness: f64) -> [f64; POSE] {
        let mut moments = Moments::default();
        let mut last = [0.0; POSE];
        for gradient in gradients {
            moments.gather(gradient, true);
            last = moments.step(1.0, strictness);
        }
        last
    }

    #[test]
    fn steps_are_as_long_as_gradients_agree() {
        let same = |_| [3.0, -2.0, 0.0, 1.0, 0.5, -4.0];
        let length = |step: [f64; POSE]| step.iter().map(|v| v * v).sum::<f64>().sqrt();
        // Gradients that agree step as Adam does, from the second visit on.
        let [plain, scaled] = [0.0, 1.0].map(|strictness| stepped((0..30).map(same), strictness));
        assert!(plain.iter().zip(scaled).all(|(a, b)| (a - b).abs() < 1e-9), "{plain:?} {scaled:?}");
        assert!((plain[0] + 1.0).abs() < 1e-9 && (plain[1] - 1.0).abs() < 1e-9, "{plain:?}");
        assert_eq!(stepped((0..1).map(same), 1.0), [0.0; POSE]);
        assert!((length(stepped((0..2).map(same), 1.0)) - 5_f64.sqrt()).abs() < 1e-9);
        // Gradients of changing signs do not; the stricter, the less.
        let other = |i: i32| if i % 2 == 0 { same(i) } else { same(i).map(|v| -v) };
        let [plain, scaled] = [0.0, 1.0].map(|strictness| length(stepped((0..30).map(other), strictness)));
        assert!(plain > 0.05 && scaled == 0.0, "{plain} {scaled}");
        let mostly = |i: i32| if i % 4 == 0 { same(i).map(|v| -v) } else { same(i) };
        let lengths = [0.0, 1.0, 2.0].map(|strictness| length(stepped((0..30).map(mostly), strictness)));
        assert!(lengths[0] > 1.2 * lengths[1] && lengths[1] > 1.2 * lengths[2] && lengths[2] > 0.0, "{lengths:?}");
        assert_eq!(stepped((0..9).map(|_| [0.0; POSE]), 1.0), [0.0; POSE]);
    }

    /// Over many series of pure chance what is left after what they have by chance is small.
    #[test]
    fn gradients_of_chance_agree_little() {
        use rand::{Rng, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        for visits in [2, 3, 10, 40] {
            let mut square = 0.0;
            for _ in 0..400 {
                let mut moments = Moments::default();
                for _ in 0..visits {
                    moments.gather([0; POSE].map(|_| rng.random_range(-1.0..1.0)), true);
                    moments.step(1.0, 1.0);
                }
                let [left1, left2] = moments.unbiased();
                let mean: f64 = moments.first.iter().map(|v| (v / left1).powi(2)).sum();
                square += mean / moments.second.iter().map(|v| v / left2).sum::<f64>() / 400.0;
            }
            let chance = [(2, 0.501), (3, 0.335), (10, 0.109), (40, 0.0542)].iter().find(|c| c.0 == visits).unwrap().1;
            assert!((square / chance - 1.0).abs() < 0.15, "{visits} visits: {square}, of {chance}");
        }
    }

    #[test]
    fn levelled_moments_have_no_mean_and_the_same_differences() {
        let one = |i: i32| Moments {
            first: [0.5 * f64::from(i), 2.0, -1.0, 0.0, 1.5, f64::from(i * i)],
            ..Moments::default()
        };
        let given: Vec<Moments> = (0..4).map(one).collect();
        let mut levelled = given.clone();
        level(&mut levelled);
        for i in 0..POSE {
            let sum: f64 = levelled.iter().map(|moments| moments.first[i]).sum();
            assert!(sum.abs() < 1e-14, "{sum}");
            let apart = |of: &[Moments]| of[3].first[i] - of[0].first[i];
            assert!((apart(&levelled) - apart(&given)).abs() < 1e-14);
        }
        assert!(levelled[0].first[0] < -0.7 && levelled[3].first[0] > 0.7, "{levelled:?}");
        level(&mut []);
    }
}
