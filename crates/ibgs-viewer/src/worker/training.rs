//! The training that the worker continues between two frames.

use super::messages::Message;
use super::{Work, WorkerState};
use std::time::Duration;
use web_time::Instant;

/// Least time between two reports of a training.
const REPORT: Duration = Duration::from_millis(100);

impl WorkerState {
    /// One iteration; the last one ends the training.
    pub(super) fn train(&self, work: &mut Work) {
        work.single = false;
        let Some(training) = work.training() else { return };
        let stepped = training.step(&|what| self.status(what));
        let progress = training.progress();
        match stepped {
            Ok(()) if progress.iteration >= progress.iterations => self.finish(work),
            Ok(()) => self.report(work, !work.running),
            Err(error) => {
                // The training cannot continue. Its model has been saved if that was possible.
                (work.running, work.unfinished) = (false, false);
                self.ended(work, Some(error));
            }
        }
    }

    /// Saves the results of the training, which ends here.
    pub(super) fn finish(&self, work: &mut Work) {
        if !std::mem::take(&mut work.unfinished) {
            return;
        }
        (work.running, work.single) = (false, false);
        let Some(training) = work.training() else { return };
        self.status("saving and measuring");
        let finished = training.finish();
        self.ended(work, finished.err());
    }

    /// Tells that the training does not go on, and why where it failed.
    fn ended(&self, work: &mut Work, error: Option<anyhow::Error>) {
        self.report(work, true);
        self.send(Message::Ended { saved: error.is_none() });
        if let Some(error) = error {
            self.failed(&error);
        }
    }

    /// Reports how far the training is, now or when it is time.
    pub(super) fn report(&self, work: &mut Work, now: bool) {
        let due = work.reported.is_none_or(|at| at.elapsed() >= REPORT);
        let running = work.running;
        if (now || due)
            && let Some(training) = work.training()
        {
            let progress = Box::new(training.progress());
            work.reported = Some(Instant::now());
            self.send(Message::Progress(progress, running));
        }
    }

    /// Ends a training that is still open.
    pub(super) fn end(&self, work: &mut Work) {
        if std::mem::take(&mut work.unfinished)
            && let Some(training) = work.training()
        {
            log::info!("stopped at iteration {}: saving and measuring", training.progress().iteration);
            if let Err(error) = training.finish() {
                self.failed(&error);
            }
        }
        work.content = None;
    }
}
