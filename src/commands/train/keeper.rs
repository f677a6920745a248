//! The checkpoints of a run: written beside the training, the last two kept.

use anyhow::{Context, Result};
use ibgs_core::tell;
use ibgs_core::train::checkpoint::{Checkpoint, CheckpointError};
use ibgs_core::train::output::OutputFolder;
use ibgs_viewer::worker::sentence;
use std::fs;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Checkpoints that stay: the last one, and one to fall back to.
const KEPT: usize = 2;

/// Writes the checkpoints of a run.
pub struct Keeper {
    folder: OutputFolder,
    /// Time between two; none: only when the training is stopped.
    every: Option<Duration>,
    /// When the last one was taken, or the run began.
    taken: Instant,
    /// The last good state; none before the first iteration.
    last: Option<Arc<Checkpoint>>,
    /// Iteration of the last one on the disk, or on its way there.
    written: Option<u32>,
    writing: Option<JoinHandle<Result<(), CheckpointError>>>,
}

impl Keeper {
    /// Checkpoints in a model folder, every so often.
    pub fn new(folder: OutputFolder, every: Option<Duration>) -> Self {
        Self { folder, every, taken: Instant::now(), last: None, written: None, writing: None }
    }

    /// Whether the state is to be taken now, and whether it is to be written.
    pub fn due(&self) -> (bool, bool) {
        let write = self.every.is_some_and(|every| self.taken.elapsed() >= every);
        (write || self.last.is_none(), write)
    }

    /// The last good state.
    pub fn last(&self) -> Option<&Arc<Checkpoint>> {
        self.last.as_ref()
    }

    /// Takes a state that is good, and begins to write it where that is wanted; what went wrong before is told as a
    /// warning, for the training itself is sound.
    pub fn take(&mut self, checkpoint: Checkpoint, write: bool) {
        self.last = Some(Arc::new(checkpoint));
        if write {
            self.taken = Instant::now();
            self.settle();
            self.begin();
        }
    }

    /// Waits until nothing is being written.
    pub fn settle(&mut self) {
        if let Err(error) = self.finish() {
            tell!("warning: {}; the training goes on without this checkpoint", sentence(&error));
        }
    }

    /// Begins to write the last state, unless that is done already.
    fn begin(&mut self) {
        let Some(checkpoint) = self.last.clone() else { return };
        let (folder, iteration) = (self.folder.clone(), checkpoint.iteration());
        if self.written == Some(iteration) {
            return;
        }
        self.written = Some(iteration);
        self.writing = Some(std::thread::spawn(move || {
            checkpoint.write(&folder.checkpoint_path(iteration))?;
            // Only now may an older one go. Whatever cannot be removed does no harm.
            for (_, path) in folder.checkpoints().unwrap_or_default().into_iter().skip(KEPT) {
                let _ = fs::remove_file(path);
            }
            Ok(())
        }));
    }

    /// Writes the last state to its end.
    pub fn write(&mut self) -> Result<()> {
        self.finish()?;
        self.begin();
        self.finish()
    }

    /// Waits until what is being written is there.
    pub fn finish(&mut self) -> Result<()> {
        let Some(writing) = self.writing.take() else { return Ok(()) };
        let outcome = writing.join().unwrap_or(Err(CheckpointError::Nonsense("its writer ended early")));
        if outcome.is_err() {
            self.written = None;
        }
        Ok(outcome?)
    }

    /// Removes all checkpoints: the run has ended, and its model is saved.
    pub fn clear(&mut self) -> Result<()> {
        // One that could not be written is not wanted any more.
        let _ = self.finish();
        for (_, path) in self.folder.checkpoints()? {
            fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
        let _ = fs::remove_dir(self.folder.checkpoints_path());
        Ok(())
    }
}
