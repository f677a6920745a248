//! What can go wrong in training.

use crate::checkpoint::CheckpointError;
use ibgs_core::eval::EvalError;
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
    /// The trial of the exposures failed.
    #[error(transparent)]
    Trial(#[from] EvalError),
    /// The checkpoint cannot be resumed from.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The data set holds no training view.
    #[error("the scene has no training view; check its split")]
    NoViews,
    /// No camera, or hardly any, shows what the training begins with.
    #[error(
        "the training cameras show {shown} of the {all} {what} that the training begins with: they are in other coordinates than the \
         cameras; export both from one program, without moving, turning or scaling either, or remove the file of the {what}"
    )]
    Unseen {
        /// Those that a camera shows.
        shown: usize,
        /// All of them.
        all: usize,
        /// `points` or `Gaussians`.
        what: &'static str,
    },
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
