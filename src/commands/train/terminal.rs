//! A training on the terminal.

use crate::commands::on_stop;
use crate::stderr;
use anyhow::Result;
use ibgs_core::output::log::TrainingProgress;
use ibgs_train::Session;
use ibgs_train::session::{Event, Observer, Summary};
use indicatif::{ProgressBar, ProgressStyle};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Iterations between two reports beside the bar.
const REPORT: u32 = 20;

/// Trains to the end, or until Ctrl-C.
pub fn train(mut session: Session) -> Result<()> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    on_stop(move || flag.store(true, Ordering::SeqCst));
    let progress = session.progress();
    let mut terminal = Terminal { bar: bar(&progress), stop };
    let outcome = session.run(&mut terminal);
    terminal.bar.finish_and_clear();
    Ok(outcome?)
}

/// Shows a training as a progress bar with messages above it.
struct Terminal {
    bar: ProgressBar,
    stop: Arc<AtomicBool>,
}

impl Observer for Terminal {
    fn iteration(&mut self, progress: &TrainingProgress) -> ControlFlow<()> {
        let TrainingProgress { iteration, loss, psnr, gaussians, .. } = *progress;
        self.bar.set_position(u64::from(iteration));
        if let (true, Some(loss), Some(psnr)) = (iteration.is_multiple_of(REPORT), loss, psnr) {
            self.bar.set_message(format!("loss {loss:.4}  PSNR {psnr:5.2}  {gaussians} Gaussians"));
        }
        if self.stop.load(Ordering::SeqCst) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn event(&mut self, event: &Event) {
        if matches!(event, Event::Stopped { .. } | Event::Finished(_)) {
            self.bar.finish_and_clear();
        }
        self.bar.suspend(|| print(event));
    }
}

/// Prints an event if it deserves a line.
pub fn print(event: &Event) {
    match event {
        // The bar pauses; the next event reports the result.
        Event::Measuring | Event::Saving => {}
        event => stderr!("{event}"),
    }
    if let Event::Finished(Summary { resumable: Some(folder), .. }) = event {
        stderr!("`ibgs train --resume -m {}` continues from here", folder.display());
    }
}

fn bar(progress: &TrainingProgress) -> ProgressBar {
    let bar = ProgressBar::new(u64::from(progress.iterations));
    let style = "{bar:28} {pos}/{len}  {msg}  {per_sec} {eta} left";
    bar.set_style(ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}
