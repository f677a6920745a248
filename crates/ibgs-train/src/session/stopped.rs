//! A training that was stopped and can be resumed.

use super::builder::BuildError;
use super::{Event, Observer};
use crate::checkpoint::{Checkpoint, CheckpointError};
use ibgs_core::config::TrainConfig;
use ibgs_core::output::OutputFolder;
use std::path::Path;

/// A training that was stopped: its folder, and the checkpoint in it that it is resumed from.
#[derive(Debug)]
pub struct StoppedTraining {
    folder: OutputFolder,
    checkpoint: Checkpoint,
}

impl StoppedTraining {
    /// Reads the newest intact checkpoint of a model folder; reports each damaged one before it.
    ///
    /// # Errors
    /// [`BuildError::NoCheckpoint`], [`BuildError::OnlyModel`], [`BuildError::Ended`]. [`BuildError::Checkpoint`] where the oldest
    /// one is damaged too, or one cannot be read or is of another version.
    pub fn open(path: &Path, observer: &mut dyn Observer) -> Result<Self, BuildError> {
        let folder = OutputFolder::at(path);
        let (found, saved) = (folder.checkpoints()?, folder.latest_iteration()?);
        let mut left = found.iter().map(|(_, path)| path).peekable();
        while let Some(path) = left.next() {
            match Checkpoint::read(path) {
                Ok(checkpoint) => return Ok(Self { folder, checkpoint }),
                Err(error @ CheckpointError::Damaged { .. }) if left.peek().is_some() => {
                    observer.event(&Event::DamagedCheckpoint { error: &error });
                }
                Err(error) => return Err(error.into()),
            }
        }
        Err(without_checkpoint(&folder, saved))
    }

    /// The model folder.
    pub fn folder(&self) -> &OutputFolder {
        &self.folder
    }

    /// What it is resumed from.
    pub fn checkpoint(&self) -> &Checkpoint {
        &self.checkpoint
    }

    /// Its options, with those of `config` that may differ.
    ///
    /// # Errors
    /// [`BuildError::OtherOption`] where another one differs.
    pub(super) fn adopt(&mut self, config: &TrainConfig) -> Result<TrainConfig, BuildError> {
        let own = &mut self.checkpoint.config;
        own.source.clone_from(&config.source);
        own.data.split.clone_from(&config.data.split);
        own.poses.cameras.clone_from(&config.poses.cameras);
        own.data.host_memory = config.data.host_memory;
        let difference = own.difference(config).map_err(|error| BuildError::Incomparable(Box::new(error)))?;
        match difference {
            None => Ok(own.clone()),
            Some(option) => {
                let path = self.folder.root().to_owned();
                Err(BuildError::OtherOption { path, option: Box::new(option) })
            }
        }
    }
}

/// Why a folder without a checkpoint, with a model of iteration `saved`, cannot be resumed.
fn without_checkpoint(folder: &OutputFolder, saved: Option<u32>) -> BuildError {
    let path = folder.root().to_owned();
    let Some(iteration) = saved else { return BuildError::NoCheckpoint { path } };
    let wanted = folder.read_config().ok().map(|config| config.iterations());
    match wanted.filter(|&iterations| iteration < iterations) {
        // Killed before its first checkpoint, and after it was saved.
        Some(iterations) => {
            let gaussians = folder.point_cloud_path(iteration);
            BuildError::OnlyModel { path, iteration, iterations, gaussians }
        }
        None => BuildError::Ended { path, iteration },
    }
}
