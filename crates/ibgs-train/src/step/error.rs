//! What can go wrong in training.

use crate::checkpoint::CheckpointError;
use ibgs_core::gpu::GpuError;
use ibgs_core::residual::weights::NetworkError;
use ibgs_core::scene::SceneError;

/// Why training stopped.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The model failed.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The network failed.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The checkpoint cannot be resumed from.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The data set holds no training view.
    #[error("the scene has no training view; check its split")]
    NoViews,
    /// The last iteration ended in the middle, so there is no state to resume from.
    #[error("iteration {0} was not finished")]
    Unfinished(u32),
    /// The loss or a value of the model is not finite.
    #[error(
        "by iteration {0} the loss or a value of the model is not a finite number; try lower learning rates, and check the \
         photos' cameras"
    )]
    NotFinite(u32),
}
