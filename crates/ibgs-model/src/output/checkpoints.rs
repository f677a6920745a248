//! The checkpoints of a model folder: what a training resumes from.

use super::{OutputError, OutputFolder};
use crate::files::{self, WriteError};
use std::fs;
use std::path::PathBuf;

impl OutputFolder {
    /// `checkpoints`.
    pub fn checkpoints_path(&self) -> PathBuf {
        self.root.join("checkpoints")
    }

    /// `checkpoints/N.ibgs`.
    pub fn checkpoint_path(&self, iteration: u32) -> PathBuf {
        self.checkpoints_path().join(format!("{iteration}.ibgs"))
    }

    /// The checkpoints with their iterations, the latest first.
    ///
    /// # Errors
    /// [`OutputError::Read`] when the folder cannot be listed; a missing one has none.
    pub fn checkpoints(&self) -> Result<Vec<(u32, PathBuf)>, OutputError> {
        let mut found = self.numbered("checkpoints", "", ".ibgs")?;
        found.sort_unstable_by_key(|(iteration, _)| std::cmp::Reverse(*iteration));
        Ok(found)
    }

    /// Removes all checkpoints but those of the iterations that are `kept`, and what a killed run left half-written beside them.
    ///
    /// # Errors
    /// [`OutputError::Read`], [`OutputError::Write`].
    pub fn remove_checkpoints(&self, kept: &[u32]) -> Result<(), OutputError> {
        let old = self.checkpoints()?.into_iter().filter(|(iteration, _)| !kept.contains(iteration));
        for path in old.map(|(_, path)| path).chain(files::leftovers(&self.checkpoints_path())) {
            fs::remove_file(&path).map_err(|source| WriteError::new(&path, source))?;
        }
        // The folder stays if it holds anything else.
        if kept.is_empty() {
            let _ = fs::remove_dir(self.checkpoints_path());
        }
        Ok(())
    }
}
