//! `training_log.json`: loss, PSNR and Gaussians over a training, for its curves.

use crate::progress::duration;
use crate::score::Score;
use serde::{Deserialize, Serialize};

/// Most entries of a log; when there are more, every other one is left out.
const MOST: usize = 1000;

/// How a training stood after an iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LogEntry {
    /// The iteration.
    pub iteration: u32,
    /// Loss, a mean over some recent iterations.
    pub loss: f32,
    /// PSNR in dB of the training photos of these iterations.
    pub psnr: f32,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Seconds spent in iterations so far.
    pub seconds: f64,
}

/// How far a training is.
#[derive(Clone, Debug, Default)]
pub struct TrainingProgress {
    /// Iterations done.
    pub iteration: u32,
    /// Iterations of the whole run.
    pub iterations: u32,
    /// Stage of the schedule.
    pub stage: &'static str,
    /// What the iterations to come will take, an estimate with the stages to come; none before the speed is known.
    pub seconds_left: Option<f64>,
    /// Mean loss of recent iterations; none where nothing has come back from the GPU yet.
    pub loss: Option<f32>,
    /// The mean absolute error in it, of values in 0 to 1.
    pub l1: Option<f32>,
    /// The mean SSIM in it.
    pub ssim: Option<f32>,
    /// Their mean PSNR against the training photos, in dB.
    pub psnr: Option<f32>,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Time spent in iterations.
    pub seconds: f64,
    /// What was measured on the held-out views so far.
    pub evaluations: Vec<Evaluation>,
}

impl TrainingProgress {
    /// The time that is left, in words.
    pub fn time_left(&self) -> Option<String> {
        self.seconds_left.map(|seconds| format!("about {} left", duration(seconds)))
    }
}

/// A measurement on the held-out views.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Evaluation {
    /// After this many iterations.
    pub iteration: u32,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Mean of the base images.
    pub base: Score,
    /// Mean of the final images, where there were any.
    pub image: Option<Score>,
}

/// The log of a training.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrainingLog {
    /// In the order of iterations.
    pub entries: Vec<LogEntry>,
    /// Iterations between two entries at least.
    spacing: u32,
}

impl TrainingLog {
    /// Adds an entry if its figures are finite, differ from the last entry's, and it is not too close to that one. The
    /// log of a long training is thinned out, so that it stays small.
    pub fn add(&mut self, entry: LogEntry) {
        let known = self.entries.last().is_some_and(|last| {
            (last.loss, last.psnr) == (entry.loss, entry.psnr)
                || entry.iteration < last.iteration.saturating_add(self.spacing)
        });
        if known || !entry.loss.is_finite() || !entry.psnr.is_finite() {
            return;
        }
        self.entries.push(entry);
        if self.entries.len() > MOST {
            let mut keep = false;
            self.entries.retain(|_| {
                keep = !keep;
                keep
            });
            let [first, last] = [&self.entries[0], &self.entries[self.entries.len() - 1]].map(|entry| entry.iteration);
            self.spacing = (last - first) / self.entries.len() as u32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logs_stay_small_and_even() {
        let mut log = TrainingLog::default();
        let entry =
            |iteration: u32| LogEntry { iteration, loss: 1.0 / iteration as f32, psnr: 20.0, ..LogEntry::default() };
        for iteration in (40..=30_000 * 32).step_by(32) {
            log.add(entry(iteration));
            log.add(entry(iteration + 1));
            log.add(LogEntry { loss: entry(iteration).loss, ..entry(iteration + 2) });
        }
        log.add(LogEntry { loss: f32::NAN, ..entry(2_000_000) });
        assert!(log.entries.len() > MOST / 3 && log.entries.len() <= MOST, "{}", log.entries.len());
        let gaps: Vec<u32> = log.entries.windows(2).map(|pair| pair[1].iteration - pair[0].iteration).collect();
        let [least, most] = [gaps.iter().min().unwrap(), gaps.iter().max().unwrap()];
        assert!(*least > 0 && most <= &(3 * least), "gaps of {least} to {most} iterations");
        assert!(log.entries[0].iteration == 40 && log.entries.last().unwrap().iteration > 950_000);
        let text = serde_json::to_string(&log).unwrap();
        assert_eq!(serde_json::from_str::<TrainingLog>(&text).unwrap(), log);
    }
}
