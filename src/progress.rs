//! Progress bars on the terminal, and what is done for a window.

use crate::stderr;
use ibgs_core::progress::Progress;
use ibgs_viewer::Status;
use indicatif::{ProgressBar, ProgressStyle};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Interval between two lines where there is no terminal to show a bar on.
const INTERVAL: Duration = Duration::from_secs(20);
/// Interval between two lines that a window shows.
const SHOWN: Duration = Duration::from_millis(100);

/// Shows each piece of work as a bar, which goes when the work ends; without a terminal, long work as a line now and then.
#[derive(Default)]
pub struct Bars<'a> {
    work: Mutex<Option<Work>>,
    window: Option<(&'a Status<'a>, &'static str)>,
}

struct Work {
    what: &'static str,
    bar: ProgressBar,
    /// When a line was written last, and when the window was told.
    told: Instant,
    shown: Instant,
}

impl<'a> Bars<'a> {
    /// Tells a window too, and that it is at `rest` between the pieces of work.
    pub fn telling(status: &'a Status<'a>, rest: &'static str) -> Self {
        status(rest);
        Self { window: Some((status, rest)), ..Self::default() }
    }

    fn work(&self) -> MutexGuard<'_, Option<Work>> {
        self.work.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Work {
    fn begin(what: &'static str, steps: usize) -> Self {
        let now = Instant::now();
        Self { what, bar: bar(what, steps), told: now, shown: now }
    }

    /// One step more, at this time; the line that is due.
    fn step(&mut self, now: Instant) -> Option<String> {
        self.bar.inc(1);
        let is_due = self.bar.is_hidden() && now.duration_since(self.told) >= INTERVAL;
        is_due.then(|| {
            self.told = now;
            self.line()
        })
    }

    /// What a window shows, where it is due.
    fn due(&mut self, now: Instant) -> Option<String> {
        let is_due = now.duration_since(self.shown) >= SHOWN;
        is_due.then(|| {
            self.shown = now;
            self.line()
        })
    }

    fn line(&self) -> String {
        format!("{}: {} of {}", self.what, self.bar.position(), self.bar.length().unwrap_or_default())
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

impl Progress for Bars<'_> {
    fn begin(&self, what: &'static str, steps: usize) {
        let work = Work::begin(what, steps);
        if let Some((status, _)) = self.window {
            status(&work.line());
        }
        *self.work() = Some(work);
    }

    fn step(&self) {
        let now = Instant::now();
        let mut work = self.work();
        let Some(work) = work.as_mut() else { return };
        if let Some(line) = work.step(now) {
            stderr!("{line}");
        }
        if let Some((status, line)) = self.window.and_then(|(status, _)| Some((status, work.due(now)?))) {
            status(&line);
        }
    }

    fn end(&self) {
        if let Some(work) = self.work().take() {
            work.bar.finish_and_clear();
        }
        if let Some((status, rest)) = self.window {
            status(rest);
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

    #[test]
    fn a_window_is_told_each_piece_of_work() {
        let told = Mutex::new(Vec::new());
        let status = |line: &str| told.lock().unwrap().push(line.to_owned());
        let bars = Bars::telling(&status, "opening");
        bars.begin("poses", 2);
        std::thread::sleep(SHOWN);
        bars.step();
        bars.step();
        bars.end();
        assert_eq!(*told.lock().unwrap(), ["opening", "poses: 0 of 2", "poses: 1 of 2", "opening"]);
    }
}
