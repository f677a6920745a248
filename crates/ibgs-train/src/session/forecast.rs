//! How long the iterations to come will take.

use ibgs_core::config::TrainConfig;
use ibgs_core::config::schedule::Schedule;
use std::time::Duration;

/// Work of an iteration with the surface losses, where one of the base alone is 1: a mean over whole trainings, in which the number
/// of Gaussians grows from stage to stage.
const SURFACE: f64 = 1.4;

/// Seconds in which one core does the work of 1 for a pixel, where a software adapter stands in for a GPU, and the most cores that
/// help it.
const SOFTWARE: f64 = 4.2e-6;
const MOST_CORES: usize = 16;

/// Seconds of iterations that the speed is taken from.
const RECENT: f64 = 30.0;
/// Fewest of them before a time is told.
const FIRST: f64 = 0.5;

/// What trains, which decides how the work of the network compares with the rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    Gpu,
    /// A software adapter.
    Processor,
}

impl Device {
    /// Work of an iteration with the residual, whose network runs at this part of the image's width and height. A GPU is quick at
    /// the products of the network, and has other work for each layer whatever its size.
    fn residual(self, factor: f64) -> f64 {
        match self {
            Self::Gpu => 1.2 + 3.3 * factor,
            Self::Processor => 1.7 + 8.8 * factor * factor,
        }
    }
}

/// The work of one member of an ensemble.
struct Member {
    /// Last iteration of each stage, and the work of one of its iterations.
    stages: [(u32, f64); 3],
}

impl Member {
    fn new(config: &TrainConfig, device: Device) -> Self {
        let iterations = config.iterations();
        let schedule = Schedule::new(config, iterations);
        let before = |first: Option<u32>| first.map_or(iterations, |first| (first - 1).min(iterations));
        let residual = device.residual(config.residual.factor());
        let ends = [schedule.surface_from(), schedule.residual_from(), None].map(before);
        Self { stages: [(ends[0], 1.0), (ends[1], SURFACE), (ends[2], residual)] }
    }

    /// Work of the iterations after `done`, up to `until`.
    fn between(&self, done: u32, until: u32) -> f64 {
        let mut first = 0;
        let stage = |&(end, work): &(u32, f64)| {
            let count = end.min(until).saturating_sub(first.max(done));
            first = end.max(first);
            f64::from(count) * work
        };
        self.stages.iter().map(stage).sum()
    }
}

/// Follows the speed of a training, and foretells its time from that and the work that is left.
pub struct Forecast {
    members: Vec<Member>,
    iterations: u32,
    /// Seconds and work of recent iterations, each counting less the longer ago it was.
    recent: [f64; 2],
    /// Iteration that it has seen last.
    last: Option<u32>,
    /// Seconds that have counted.
    seen: f64,
}

impl Forecast {
    /// Of a training with these options on this device.
    pub fn new(config: &TrainConfig, device: Device) -> Self {
        let others = (2..=config.ensemble()).map(|number| Member::new(&config.of_member(number), device));
        let members = std::iter::once(Member::new(config, device)).chain(others).collect();
        Self { members, iterations: config.iterations(), recent: [0.0; 2], last: None, seen: 0.0 }
    }

    /// Work of the iterations after `done`, up to `until`.
    fn work(&self, done: u32, until: u32) -> f64 {
        self.members.iter().map(|member| member.between(done, until)).sum()
    }

    /// Seconds that a software adapter needs for the whole training, of photos with so many pixels, on so many cores.
    pub fn on_software(&self, pixels: f64, cores: usize) -> f64 {
        self.work(0, self.iterations) * pixels * SOFTWARE / cores.clamp(1, MOST_CORES) as f64
    }

    /// Counts an iteration that took so long. The first one, and that of a new stage, do not count: kernels are compiled in them.
    pub fn count(&mut self, iteration: u32, time: Duration) {
        let before = iteration.saturating_sub(1);
        let work = self.work(before, iteration);
        let goes_on = self.last == Some(before) && self.work(before.saturating_sub(1), before) == work;
        self.last = Some(iteration);
        if goes_on {
            let seconds = time.as_secs_f64();
            let keep = (-seconds / RECENT).exp();
            self.recent = [keep * self.recent[0] + seconds, keep * self.recent[1] + work];
            self.seen += seconds;
        }
    }

    /// Seconds from the end of this iteration to that of the training; none before the speed is known.
    pub fn left(&self, iteration: u32) -> Option<f64> {
        let [seconds, work] = self.recent;
        (self.seen >= FIRST && work > 0.0).then(|| seconds / work * self.work(iteration, self.iterations))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ibgs_core::config::{Method, Preset};

    /// What is foretold after each iteration of a training whose iterations take `time` of their work.
    fn foretold(config: &TrainConfig, device: Device, time: impl Fn(u32, f64) -> f64) -> (Vec<Option<f64>>, Vec<f64>) {
        let mut forecast = Forecast::new(config, device);
        let all = 1..=config.iterations();
        let seconds: Vec<f64> = all.clone().map(|i| time(i, forecast.work(i - 1, i))).collect();
        let mut told = Vec::new();
        for (iteration, &seconds) in all.zip(&seconds) {
            forecast.count(iteration, Duration::from_secs_f64(seconds));
            told.push(forecast.left(iteration));
        }
        let left = (0..seconds.len()).map(|done| seconds[done + 1..].iter().sum()).collect();
        (told, left)
    }

    #[test]
    fn the_stages_to_come_count_from_the_start() {
        for preset in [Preset::Default, Preset::Fast, Preset::Best] {
            let config = TrainConfig { iterations: Some(1_000), ..TrainConfig::preset(preset) };
            let (told, left) = foretold(&config, Device::Gpu, |i, work| if i == 1 { 9.0 } else { 0.1 * work });
            let first = told.iter().position(Option::is_some).unwrap();
            // All but the first iteration count.
            let counted = left[0] - left[first];
            assert!((FIRST..FIRST + 1.0).contains(&counted), "told after {counted} s");
            for (told, left) in told.iter().zip(left).skip(first) {
                assert!((told.unwrap() - left).abs() < 1e-6 * (1.0 + left), "{told:?} of {left}");
            }
        }
    }

    /// The demo scene on two cores, as the README has it: 0.039, 0.056 and 0.16 s an iteration.
    #[test]
    fn a_real_training_is_foretold_within_a_quarter() {
        let mut config = TrainConfig { iterations: Some(200), ..TrainConfig::default() };
        config.residual.factor = Some(0.5);
        let (told, left) = foretold(&config, Device::Processor, |i, _| match i {
            ..48 => 0.039,
            48..68 => 0.056,
            _ => 0.16,
        });
        let told: Vec<(f64, f64)> = told.into_iter().zip(left).filter_map(|(told, left)| Some((told?, left))).collect();
        assert!(told.len() > 180, "{}", told.len());
        for (told, left) in &told {
            assert!((told / left - 1.0).abs() < 0.25 || *left == 0.0, "{told} of {left}");
        }
        let jumps = told.windows(2).map(|pair| pair[1].0 - pair[0].0);
        assert!(jumps.fold(0.0, f64::max) < 1.0, "no stage makes the time jump up");
        let before = Forecast::new(&config, Device::Processor).on_software(160.0 * 120.0, 2);
        assert!((before / 24.2 - 1.0).abs() < 0.25, "{before} s before it begins");
    }

    #[test]
    fn work_is_that_of_the_schedule() {
        let plain = TrainConfig { method: Method::Gs3, iterations: Some(300), ..TrainConfig::default() };
        let whole = |forecast: &Forecast| forecast.work(0, forecast.iterations);
        assert_eq!(whole(&Forecast::new(&plain, Device::Gpu)), 300.0);
        let config = TrainConfig { iterations: Some(3_000), ..TrainConfig::default() };
        let forecast = Forecast::new(&config, Device::Gpu);
        let expected = 700.0 + 300.0 * SURFACE + 2_000.0 * Device::Gpu.residual(1.0);
        assert!((whole(&forecast) - expected).abs() < 1e-9, "{} of {expected}", whole(&forecast));
        let two = Forecast::new(&TrainConfig { ensemble: Some(2), ..config }, Device::Gpu);
        assert!((whole(&two) - expected - 3_000.0).abs() < 1e-9, "the second base is plain splatting");
    }

    #[test]
    fn after_a_return_to_an_earlier_state_the_speed_stays_known() {
        let config = TrainConfig { method: Method::Gs3, iterations: Some(100), ..TrainConfig::default() };
        let mut forecast = Forecast::new(&config, Device::Gpu);
        (1..=50).for_each(|i| forecast.count(i, Duration::from_secs(1)));
        forecast.count(21, Duration::from_secs(60));
        assert!((forecast.left(21).unwrap() - 79.0).abs() < 1e-9);
    }
}
