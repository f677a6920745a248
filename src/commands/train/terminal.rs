//! A training on the terminal.

use super::pace::Pace;
use crate::advice;
use crate::signals::on_stop;
use crate::stderr;
use anyhow::Result;
use ibgs_core::output::log::TrainingProgress;
use ibgs_train::Session;
use ibgs_train::session::{Event, JsonLines, Observer, Summary};
use indicatif::{ProgressBar, ProgressStyle};
use std::fs::File;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Iterations between two reports beside the bar.
const REPORT: u32 = 20;

/// Trains to the end, or until Ctrl-C; with records for `log` where there is one.
pub fn train(session: &mut Session, log: Option<JsonLines<File>>) -> Result<()> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    on_stop(move || flag.store(true, Ordering::SeqCst));
    let progress = session.progress();
    let pace = Pace::new(progress.iteration, Instant::now());
    let mut terminal = Terminal { bar: bar(&progress), pace, log, stop };
    let outcome = session.run(&mut terminal);
    terminal.bar.finish_and_clear();
    Ok(outcome?)
}

/// Shows a training as a progress bar with messages above it, or in lines where no terminal shows bars.
struct Terminal {
    bar: ProgressBar,
    pace: Pace,
    log: Option<JsonLines<File>>,
    stop: Arc<AtomicBool>,
}

impl Observer for Terminal {
    fn iteration(&mut self, progress: &TrainingProgress) -> ControlFlow<()> {
        let TrainingProgress { iteration, loss, psnr, gaussians, .. } = *progress;
        self.bar.set_position(u64::from(iteration));
        self.bar.set_prefix(progress.time_left().unwrap_or_default());
        if let (true, Some(loss), Some(psnr)) = (iteration.is_multiple_of(REPORT), loss, psnr) {
            self.bar.set_message(format!("loss {loss:.4}  PSNR {psnr:5.2}  {gaussians} Gaussians"));
        }
        if self.bar.is_hidden()
            && let Some(line) = self.pace.line(progress, Instant::now())
        {
            stderr!("{line}");
        }
        // It never ends a training.
        let _ = self.log.iteration(progress);
        if self.stop.load(Ordering::SeqCst) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn event(&mut self, event: &Event) {
        self.log.event(event);
        if matches!(event, Event::Stopped { .. } | Event::Finished(_)) {
            self.bar.finish_and_clear();
        }
        self.bar.suspend(|| print(event));
    }
}

/// Whether an event is work that begins, whose result a later event reports. A window shows it; on the terminal the bar pauses.
pub fn is_status(event: &Event) -> bool {
    matches!(event, Event::Loading | Event::Preparing | Event::Measuring | Event::Saving)
}

/// Prints an event if it deserves a line.
pub fn print(event: &Event) {
    if !is_status(event) {
        stderr!("{}", advice::event(event));
    }
    if let Event::Finished(Summary { resumable: Some(folder), .. }) = event {
        stderr!("{} continues from here", advice::resume(folder));
    }
}

fn bar(progress: &TrainingProgress) -> ProgressBar {
    let bar = ProgressBar::new(u64::from(progress.iterations));
    let style = "{bar:28} {pos}/{len}  {msg}  {per_sec}  {prefix}";
    bar.set_style(ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}
