//! Lines about a training that no bar shows, for log files: each after half a minute or a twentieth of the iterations.

use ibgs_core::output::log::TrainingProgress;
use std::time::{Duration, Instant};

/// Longest time between two lines.
const EVERY: Duration = Duration::from_secs(30);
/// Lines of a training that is quicker than that.
const LINES: u32 = 20;

/// When the last line was, and at which iteration.
pub struct Pace {
    iteration: u32,
    at: Instant,
}

impl Pace {
    /// Of a training that stands at this iteration.
    pub fn new(iteration: u32, now: Instant) -> Self {
        Self { iteration, at: now }
    }

    /// The line that is due after an iteration, where one is; the last iteration has its own report.
    pub fn line(&mut self, progress: &TrainingProgress, now: Instant) -> Option<String> {
        let TrainingProgress { iteration, iterations, loss, psnr, gaussians, .. } = *progress;
        if iteration < self.iteration {
            // It has gone back to an earlier state.
            *self = Self::new(iteration, now);
        }
        let (done, time) = (iteration - self.iteration, now.saturating_duration_since(self.at));
        let is_due = time >= EVERY || done >= iterations.div_ceil(LINES);
        if done == 0 || !is_due || iteration >= iterations {
            return None;
        }
        *self = Self::new(iteration, now);
        let percent = 100 * u64::from(iteration) / u64::from(iterations);
        let mut line = format!("iteration {iteration} of {iterations} ({percent} %): ");
        if let (Some(loss), Some(psnr)) = (loss, psnr) {
            line += &format!("loss {loss:.4}, PSNR {psnr:.2} dB on training photos, ");
        }
        let left = progress.time_left().map_or_else(String::new, |left| format!(", {left}"));
        Some(line + &format!("{gaussians} Gaussians{left}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(iteration: u32, iterations: u32) -> TrainingProgress {
        TrainingProgress { iteration, iterations, gaussians: 300, ..TrainingProgress::default() }
    }

    #[test]
    fn lines_come_after_a_twentieth_or_half_a_minute() {
        let start = Instant::now();
        let after = |seconds| start + Duration::from_secs(seconds);
        let mut pace = Pace::new(0, start);
        assert_eq!(pace.line(&at(49, 1000), after(10)), None);
        let line = pace.line(&at(50, 1000), after(10)).unwrap();
        assert_eq!(line, "iteration 50 of 1000 (5 %): 300 Gaussians");
        // Slower now: the time counts, from the line before.
        assert_eq!(pace.line(&at(59, 1000), after(39)), None);
        let known = TrainingProgress { loss: Some(0.25), psnr: Some(20.0), seconds_left: Some(2820.0), ..at(60, 1000) };
        assert_eq!(
            pace.line(&known, after(40)).unwrap(),
            "iteration 60 of 1000 (6 %): loss 0.2500, PSNR 20.00 dB on training photos, 300 Gaussians, about 47 min 00 s left"
        );
        // Back to an earlier state: counted from there.
        assert_eq!(pace.line(&at(30, 1000), after(41)), None);
        assert_eq!(pace.line(&at(79, 1000), after(42)), None);
        assert!(pace.line(&at(80, 1000), after(43)).unwrap().starts_with("iteration 80 of 1000 (8 %): "));
        assert_eq!(pace.line(&at(1000, 1000), after(900)), None, "the end has its own report");
    }

    #[test]
    fn short_trainings_have_a_line_an_iteration_at_most() {
        let (start, mut lines) = (Instant::now(), 0);
        let mut pace = Pace::new(0, start);
        for iteration in 1..=4 {
            lines += usize::from(pace.line(&at(iteration, 4), start).is_some());
        }
        assert_eq!(lines, 3);
    }
}
