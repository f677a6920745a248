//! Progress bars on the terminal.

use crate::stderr;
use ibgs_core::progress::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Interval between two lines where there is no terminal to show a bar on.
const INTERVAL: Duration = Duration::from_secs(20);

/// Shows each piece of work as a bar, which goes when the work ends; without a terminal, long work as a line now and then.
#[derive(Default)]
pub struct Bars(Mutex<Option<Work>>);

struct Work {
    what: &'static str,
    bar: ProgressBar,
    told: Instant,
}

impl Bars {
    fn work(&self) -> MutexGuard<'_, Option<Work>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Work {
    fn begin(what: &'static str, steps: usize) -> Self {
        Self { what, bar: bar(what, steps), told: Instant::now() }
    }

    /// One step more, at this time; the line that is due.
    fn step(&mut self, now: Instant) -> Option<String> {
        self.bar.inc(1);
        let is_due = self.bar.is_hidden() && now.duration_since(self.told) >= INTERVAL;
        is_due.then(|| {
            self.told = now;
            format!("{}: {} of {}", self.what, self.bar.position(), self.bar.length().unwrap_or_default())
        })
    }
}

/// A bar with these words before it.
pub fn bar(what: &'static str, steps: usize) -> ProgressBar {
    let bar = ProgressBar::new(steps as u64).with_message(what);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len}, {eta} left") {
        bar.set_style(style);
    }
    bar
}

/// A sign that something of unknown length is being done.
pub fn spinner(what: &'static str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner().with_message(what);
    // On a terminal alone: it needs a thread of its own.
    if !spinner.is_hidden() {
        spinner.enable_steady_tick(Duration::from_millis(120));
    }
    spinner
}

impl Progress for Bars {
    fn begin(&self, what: &'static str, steps: usize) {
        *self.work() = Some(Work::begin(what, steps));
    }

    fn step(&self) {
        if let Some(line) = self.work().as_mut().and_then(|work| work.step(Instant::now())) {
            stderr!("{line}");
        }
    }

    fn end(&self) {
        if let Some(work) = self.work().take() {
            work.bar.finish_and_clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use indicatif::ProgressDrawTarget;

    #[test]
    fn without_a_terminal_a_line_is_due_now_and_then() {
        let mut work = Work::begin("poses", 9);
        work.bar.set_draw_target(ProgressDrawTarget::hidden());
        let start = work.told;
        let told = [0, 1, 19, 20, 21, 40].map(|second| work.step(start + Duration::from_secs(second)));
        let line = |done| Some(format!("poses: {done} of 9"));
        assert_eq!(told, [None, None, None, line(4), None, line(6)]);
    }
}
