//! Why a session cannot begin.

use crate::TrainError;
use crate::checkpoint::CheckpointError;
use crate::memory::DoesNotFit;
use ibgs_core::config::{ConfigError, OptionDifference};
use ibgs_core::counted;
use ibgs_core::dataset::DatasetError;
use ibgs_core::files::WriteError;
use ibgs_core::gpu::GpuError;
use ibgs_core::model::ModelError;
use ibgs_core::output::OutputError;
use ibgs_core::residual::NetworkError;
use std::error::Error;
use std::path::PathBuf;

/// Why a session cannot begin or be resumed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The options.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The scene.
    #[error(transparent)]
    Scene(#[from] DatasetError),
    /// The Gaussians, or the model, that it begins with.
    #[error(transparent)]
    Start(#[from] ModelError),
    /// The network that it begins with.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The GPU, before the trainer is made.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The trainer.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// The device's memory.
    #[error(transparent)]
    DoesNotFit(#[from] DoesNotFit),
    /// The model folder.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A file.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The options name no scene, and none is given.
    #[error("there is no scene to train on")]
    NoScene,
    /// The model folder is that of the scene.
    #[error("{} is the scene itself", path.display())]
    IsScene {
        /// The folder.
        path: PathBuf,
    },
    /// A resumed training would have another option.
    #[error(
        "the training in {} has the option `{}` at {}, not {}; a resumed run keeps its options: leave it out",
        path.display(),
        option.name,
        option.first.as_deref().unwrap_or("unset"),
        option.second.as_deref().unwrap_or("unset")
    )]
    OtherOption {
        /// The folder.
        path: PathBuf,
        /// The option, first as the training has it.
        option: Box<OptionDifference>,
    },
    /// Options cannot be compared with those of the training that is resumed.
    #[error(transparent)]
    Incomparable(Box<dyn Error + Send + Sync>),
    /// A training was killed before its first checkpoint, after its model was saved.
    #[error(
        "{} has no checkpoint to resume from, only the model of iteration {iteration} of {iterations}",
        path.display()
    )]
    OnlyModel {
        /// The folder.
        path: PathBuf,
        /// Iteration of the model.
        iteration: u32,
        /// Iterations that it was to have.
        iterations: u32,
        /// File of its Gaussians.
        gaussians: PathBuf,
    },
    /// The training in the folder has come to its end.
    #[error(
        "the training in {} has ended, its model has {}; there is nothing to resume",
        path.display(), counted(*iteration, "iteration")
    )]
    Ended {
        /// The folder.
        path: PathBuf,
        /// Iteration of the model.
        iteration: u32,
    },
    /// Nothing in the folder can be resumed.
    #[error("{} holds no checkpoint to resume from", path.display())]
    NoCheckpoint {
        /// The folder.
        path: PathBuf,
    },
}
