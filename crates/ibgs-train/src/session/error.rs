//! Why a session ended early.

use crate::TrainError;
use crate::checkpoint::CheckpointError;
use ibgs_core::eval::EvalError;
use ibgs_core::files::WriteError;
use ibgs_core::gpu::GpuError;
use ibgs_core::output::OutputError;
use ibgs_core::residual::NetworkError;
use ibgs_core::scene::SceneError;
use std::path::PathBuf;

/// Why a session ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The training.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// The GPU.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The measuring of held-out views.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// The model folder.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A file.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The Gaussians.
    #[error(transparent)]
    Gaussians(#[from] SceneError),
    /// The network.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// What a run keeps beside its training.
    #[error("the records of the training: {0}")]
    Records(#[from] serde_json::Error),
    /// The training failed, and what there was is saved.
    #[error("training stopped; {}", there(saved.as_deref(), *checkpoint))]
    Stopped {
        /// Why.
        source: Box<SessionError>,
        /// The model folder.
        folder: PathBuf,
        /// Where the model so far is, where it could be saved.
        saved: Option<PathBuf>,
        /// Iteration of the checkpoint to resume from, where there is one.
        checkpoint: Option<u32>,
    },
    /// The training was stopped and can be resumed, but not everything was saved and measured.
    #[error("the checkpoint of iteration {iteration} is whole, but not everything was saved and measured")]
    OnlyCheckpoint {
        /// Iteration of the checkpoint.
        iteration: u32,
        /// The model folder.
        folder: PathBuf,
        /// What failed.
        source: Box<SessionError>,
    },
}

impl SessionError {
    /// Whether a file could not be written, and the training itself is sound.
    pub(super) fn is_unwritten(&self) -> bool {
        matches!(
            self,
            Self::Write(_)
                | Self::Output(OutputError::Write(_))
                | Self::Eval(EvalError::Write(_))
                | Self::Gaussians(SceneError::Write(_))
                | Self::Network(NetworkError::Write(_))
        )
    }
}

fn there(saved: Option<&std::path::Path>, checkpoint: Option<u32>) -> String {
    match (saved, checkpoint) {
        (Some(path), Some(iteration)) => {
            format!("the model so far is in {}, and there is a checkpoint of iteration {iteration}", path.display())
        }
        (Some(path), None) => format!("the model so far is in {}", path.display()),
        (None, Some(iteration)) => format!("there is a checkpoint of iteration {iteration}"),
        (None, None) => "nothing could be saved".to_owned(),
    }
}
