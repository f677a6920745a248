//! The checkpoints of a run: written beside the training, the last two kept.

use super::{Event, Observer, Result};
use crate::checkpoint::{Checkpoint, CheckpointError};
use ibgs_core::output::OutputFolder;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Shortest and longest interval between two states kept in memory, in case memory runs out or the device is lost. The
/// interval grows with the time that taking a state costs.
const IN_MEMORY: [Duration; 2] = [Duration::from_secs(30), Duration::from_secs(120)];

/// Writes the checkpoints of a run.
pub struct CheckpointWriter {
    /// None: nothing is written.
    folder: Option<OutputFolder>,
    /// Time between two; none: only when the training is stopped.
    every: Option<Duration>,
    /// When the last one was written, or the run began.
    began: Instant,
    /// When the last state was taken.
    taken: Instant,
    /// Time until the next one is.
    pause: Duration,
    /// The last good state; none before the first iteration.
    last: Option<Arc<Checkpoint>>,
    /// Iteration of the last one that is whole on the disk.
    written: Option<u32>,
    /// The one on its way there.
    writing: Option<(u32, JoinHandle<std::result::Result<(), CheckpointError>>)>,
}

impl CheckpointWriter {
    /// Checkpoints in a model folder, every so often.
    pub fn new(folder: Option<OutputFolder>, every: Option<Duration>) -> Self {
        let now = Instant::now();
        Self { folder, every, began: now, taken: now, pause: IN_MEMORY[0], last: None, written: None, writing: None }
    }

    /// The training is resumed from a checkpoint in the folder.
    pub fn resumed(&mut self, iteration: u32) {
        self.written = Some(iteration);
    }

    /// The training returned to its last good state: files written since are removed with the next checkpoint.
    pub fn went_back(&mut self, observer: &mut dyn Observer) {
        self.wait(observer);
        let good = self.last.as_ref().map(|last| last.iteration());
        self.written = self.written.filter(|&written| good == Some(written));
    }

    /// Whether the state is to be taken now, and whether it is to be written.
    pub fn due(&self) -> (bool, bool) {
        let write = self.every.is_some_and(|every| self.began.elapsed() >= every);
        (write || self.last.is_none() || self.taken.elapsed() >= self.pause, write)
    }

    /// The last good state.
    pub fn last(&self) -> Option<&Arc<Checkpoint>> {
        self.last.as_ref()
    }

    /// Takes a good state and the time that reading it took.
    pub fn take(&mut self, checkpoint: Checkpoint, cost: Duration) {
        self.last = Some(Arc::new(checkpoint));
        self.taken = Instant::now();
        self.pause = (100 * cost).clamp(IN_MEMORY[0], IN_MEMORY[1]);
    }

    /// Begins to write the last state; an earlier failure is a warning, because the training itself is sound.
    pub fn begin(&mut self, observer: &mut dyn Observer) {
        self.began = Instant::now();
        self.wait(observer);
        self.write_last();
    }

    /// Waits until nothing is being written.
    pub fn wait(&mut self, observer: &mut dyn Observer) {
        if let Err(error) = self.finish() {
            observer.event(&Event::NoCheckpoint { error: &error });
        }
    }

    /// Begins to write the last state, unless that is done already.
    fn write_last(&mut self) {
        let (Some(checkpoint), Some(folder)) = (self.last.clone(), self.folder.clone()) else { return };
        let iteration = checkpoint.iteration();
        if self.written == Some(iteration) {
            return;
        }
        // Two stay: this one, and the whole one before to fall back to. Others are older, or were found damaged.
        let kept: Vec<u32> = self.written.into_iter().chain([iteration]).collect();
        let writing = std::thread::spawn(move || {
            checkpoint.write(&folder.checkpoint_path(iteration))?;
            // Only now may an older one go. Whatever cannot be removed does no harm.
            let _ = folder.remove_checkpoints(&kept);
            Ok(())
        });
        self.writing = Some((iteration, writing));
    }

    /// Writes the last state to its end.
    pub fn write(&mut self, observer: &mut dyn Observer) -> Result<()> {
        self.wait(observer);
        self.write_last();
        self.finish()
    }

    /// Waits until what is being written is there.
    pub fn finish(&mut self) -> Result<()> {
        let Some((iteration, writing)) = self.writing.take() else { return Ok(()) };
        writing.join().unwrap_or(Err(CheckpointError::Nonsense("its writer ended early")))?;
        self.written = Some(iteration);
        Ok(())
    }

    /// Removes all checkpoints: the run has ended, and its model is saved.
    pub fn clear(&mut self) -> Result<()> {
        // One that could not be written is dropped.
        let _ = self.finish();
        match &self.folder {
            Some(folder) => Ok(folder.remove_checkpoints(&[])?),
            None => Ok(()),
        }
    }
}
