//! What a session reports, and to whom.

use super::{CameraSummary, Preparation, SessionError, SmallNetwork, TrainingProgress, TransientSummary};
use crate::ExposureEvidence;
use crate::checkpoint::CheckpointError;
use crate::memory::MemoryLimit;
use ibgs_core::config::LengthReason;
use ibgs_core::counted;
use ibgs_core::eval::scores::Scores;
use ibgs_core::progress::Progress;
use std::error::Error;
use std::fmt;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Duration;

/// Receives the events of a training. `()` ignores them.
pub trait Observer {
    /// An iteration is done. [`ControlFlow::Break`] ends the training as if it were its last one, but what it resumes from is
    /// kept.
    fn iteration(&mut self, progress: &TrainingProgress) -> ControlFlow<()> {
        let _ = progress;
        ControlFlow::Continue(())
    }

    /// Something happened beside the iterations.
    fn event(&mut self, event: &Event) {
        let _ = event;
    }

    /// Receives how far the loading of the scene is, and other long work before the first iteration.
    fn progress(&self) -> &dyn Progress {
        &()
    }
}

impl Observer for () {}

/// Without one nothing is observed.
impl<O: Observer> Observer for Option<O> {
    fn iteration(&mut self, progress: &TrainingProgress) -> ControlFlow<()> {
        self.as_mut().map_or(ControlFlow::Continue(()), |observer| observer.iteration(progress))
    }

    fn event(&mut self, event: &Event) {
        if let Some(observer) = self {
            observer.event(event);
        }
    }

    fn progress(&self) -> &dyn Progress {
        self.as_ref().map_or(&(), |observer| observer.progress())
    }
}

/// What happens before and beside the iterations of a training.
#[derive(Debug)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A checkpoint cannot be read; the training resumes from the one before.
    DamagedCheckpoint {
        /// Why.
        error: &'a CheckpointError,
    },
    /// The scene will be loaded.
    Loading,
    /// Something worth knowing about the scene.
    Note(&'a str),
    /// The scene is complete, and the training will be prepared on the device.
    Preparing,
    /// It was tried whether exposures are worth correcting.
    ExposureTried(&'a ExposureEvidence),
    /// The network runs at less than the image's size, as a frame would take too long else.
    SmallNetwork(&'a SmallNetwork),
    /// Not all Gaussians that the options allow fit into the device's memory.
    Limited(&'a MemoryLimit),
    /// The training runs on a software adapter, and will take long.
    Slow {
        /// Name of the adapter.
        adapter: &'a str,
        /// What it will roughly take.
        seconds: f64,
    },
    /// A stopped training will be resumed.
    Resuming {
        /// Iterations done.
        iteration: u32,
        /// Iterations of the whole run.
        iterations: u32,
    },
    /// The training is prepared, and its folder locked.
    Prepared(&'a Preparation),
    /// The held-out views will be rendered and measured.
    Measuring,
    /// The model will be saved.
    Saving,
    /// The held-out views were measured.
    Evaluated {
        /// Iteration.
        iteration: u32,
        /// Number of Gaussians.
        gaussians: usize,
        /// Scores of every view.
        scores: &'a Scores,
        /// Mean time of an iteration so far.
        iteration_time: Duration,
    },
    /// A value was not finite: the training has returned to its last good state.
    RolledBack {
        /// What was found.
        error: &'a SessionError,
        /// Iteration of the state.
        iteration: u32,
        /// Factor on the learning rates from now on.
        rates: f64,
    },
    /// A file of a save or of a measurement cannot be written; the training continues without.
    NotSaved {
        /// Why.
        error: &'a SessionError,
    },
    /// A checkpoint cannot be written; the training continues without.
    NoCheckpoint {
        /// Why.
        error: &'a SessionError,
    },
    /// Times and curves of a checkpoint cannot be read.
    NoRecords {
        /// Why.
        error: String,
    },
    /// The training was stopped before its last iteration.
    Stopped {
        /// The iteration before.
        iteration: u32,
    },
    /// Some iterations had more tile intersections than room and were left out.
    Overflowed,
    /// The training has ended, and its model is saved where it has a folder.
    Finished(&'a Summary),
}

/// A training that has ended.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Iterations done.
    pub iteration: u32,
    /// Why it ended there; none where it was stopped, or its length was asked for.
    pub length: Option<LengthReason>,
    /// Time of the iterations.
    pub training: Duration,
    /// Time of everything else.
    pub beside: Duration,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Time and memory of each stage, in words.
    pub stages: String,
    /// What became of the photos' exposures.
    pub exposure: ExposureSummary,
    /// What became of the photos' cameras, where they were refined.
    pub cameras: Option<CameraSummary>,
    /// What was found of what moves; none where no masks are learned.
    pub transients: Option<TransientSummary>,
    /// Where it can be resumed from; none after the last iteration or without a folder.
    pub resumable: Option<PathBuf>,
}

/// What became of the photos' exposures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExposureSummary {
    /// Exposure correction was off.
    Off,
    /// They were corrected.
    Corrected {
        /// Root mean square of their gains.
        spread: f64,
        /// Part of the gains and of the offsets that can be predicted from the neighbouring photos.
        predicted: [f64; 2],
    },
}

impl fmt::Display for ExposureSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("exposure: off"),
            Self::Corrected { spread, predicted } => {
                let [gains, offsets] = predicted.map(|part| 100.0 * part);
                write!(
                    f,
                    "exposure: the photos differ by {:.1} % (root mean square of their gains); {gains:.0} % of that can be \
                     predicted from the photos around, {offsets:.0} % of their offsets",
                    100.0 * spread
                )
            }
        }
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "trained {} in {:.1} s (start-up, evaluation and saving {:.1} s more); {} Gaussians\nstages: {}",
            counted(self.iteration, "iteration"),
            self.training.as_secs_f64(),
            self.beside.as_secs_f64(),
            self.gaussians,
            self.stages
        )?;
        if let Some(reason) = self.length {
            write!(f, "\nlength: {}, {reason}", counted(self.iteration, "iteration"))?;
        }
        if self.exposure != ExposureSummary::Off {
            write!(f, "\n{}", self.exposure)?;
        }
        if let Some(cameras) = &self.cameras {
            write!(f, "\n{cameras}")?;
        }
        match &self.transients {
            Some(transients) => write!(f, "\n{transients}"),
            None => Ok(()),
        }
    }
}

/// A long time in words, without a precision that an estimate does not have.
fn roughly(seconds: f64) -> String {
    let hours = seconds / 3600.0;
    match hours {
        ..1.5 => format!("{:.0} minutes", 60.0 * hours),
        ..36.0 => format!("{hours:.0} hours"),
        _ => format!("{:.0} days", hours / 24.0),
    }
}

impl Event<'_> {
    /// The event as text. `words` formats an error, because a program can say more about it than this library.
    pub fn with_errors<'e>(&'e self, words: &'e dyn Fn(&(dyn Error + 'static)) -> String) -> impl fmt::Display + 'e {
        fmt::from_fn(move |f| self.write(f, words))
    }

    fn write(&self, f: &mut fmt::Formatter<'_>, words: &dyn Fn(&(dyn Error + 'static)) -> String) -> fmt::Result {
        match self {
            Self::DamagedCheckpoint { error } => {
                write!(f, "warning: {}; resuming from the one before", words(*error))
            }
            Self::Loading => f.write_str("loading the photos"),
            Self::Note(note) => write!(f, "note: {note}"),
            Self::Preparing => f.write_str("preparing the training"),
            Self::ExposureTried(evidence) => fmt::Display::fmt(evidence, f),
            Self::SmallNetwork(network) => fmt::Display::fmt(network, f),
            Self::Limited(limit) => write!(f, "warning: {limit}"),
            Self::Slow { adapter, seconds } => write!(
                f,
                "note: {adapter} is no GPU but computes on the processor: this training will take about {}",
                roughly(*seconds)
            ),
            Self::Resuming { iteration, iterations } => {
                write!(f, "resuming from iteration {iteration} of {iterations}")
            }
            Self::Prepared(preparation) => fmt::Display::fmt(preparation, f),
            Self::Measuring => f.write_str("measuring on the held-out views"),
            Self::Saving => f.write_str("saving"),
            Self::Evaluated { iteration, gaussians, scores, iteration_time } => {
                write!(
                    f,
                    "iteration {iteration}: test {} over {}; {gaussians} Gaussians, {:.2} ms an iteration so far",
                    scores.sentence(),
                    counted(scores.base.len(), "view"),
                    1e3 * iteration_time.as_secs_f64()
                )?;
                let more = [scores.regions_sentence(), scores.masked_sentence(), scores.fitted_sentence()];
                more.into_iter().flatten().try_for_each(|line| write!(f, "\n   {line}"))
            }
            Self::RolledBack { error, iteration, rates } => {
                write!(
                    f,
                    "warning: {}; going back to iteration {iteration}, once, with {rates} times the learning rates",
                    words(*error)
                )
            }
            Self::NotSaved { error } => {
                write!(f, "warning: {}; the training continues, and saves again later", words(*error))
            }
            Self::NoCheckpoint { error } => {
                write!(f, "warning: {}; the training continues without this checkpoint", words(*error))
            }
            Self::NoRecords { error } => {
                write!(f, "note: times and curves of the iterations before are lost ({error})")
            }
            Self::Stopped { iteration } => write!(f, "stopped at iteration {iteration}: saving and evaluating"),
            Self::Overflowed => f.write_str(
                "note: some iterations had more tile intersections than there was room for, and were left out",
            ),
            Self::Finished(summary) => fmt::Display::fmt(summary, f),
        }
    }
}

impl fmt::Display for Event<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write(f, &|error| ibgs_core::sentence(error))
    }
}
