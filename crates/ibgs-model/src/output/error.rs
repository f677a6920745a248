//! Why an output folder cannot be used.

use crate::config::ConfigError;
use crate::counted;
use crate::files::WriteError;
use crate::scene::SceneError;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Why the output folder cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OutputError {
    /// A model is there already.
    #[error("{} already holds a model trained for {}", path.display(), counted(*iteration, "iteration"))]
    HoldsModel {
        /// The folder.
        path: PathBuf,
        /// Its latest iteration.
        iteration: u32,
    },
    /// A training stopped there.
    #[error("{} holds a training that stopped after iteration {iteration}", path.display())]
    HoldsTraining {
        /// The folder.
        path: PathBuf,
        /// Iteration of its latest checkpoint.
        iteration: u32,
    },
    /// Another training writes into it now.
    #[error("{} is being trained into by another run; choose another folder or wait for its end", path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// The folder belongs to something else.
    #[error("{} holds a `{file}` that no training run wrote; perhaps it is a scene folder", path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
        /// The file that would be replaced.
        file: &'static str,
    },
    /// The folder is no model.
    #[error("{} holds no trained model (no point_cloud/iteration_N/point_cloud.ply); train one or check the path", path.display())]
    NoModel {
        /// The folder.
        path: PathBuf,
    },
    /// The operating system refused to read.
    #[error("cannot read {}: {source}; check the path", path.display())]
    Read {
        /// File or folder.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// A JSON file of the folder does not have the form it should.
    #[error("{} is damaged: {reason}; restore it or train again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line or camera.
        reason: String,
    },
    /// Writing failed.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The options cannot be written or read.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A PLY file cannot be written.
    #[error(transparent)]
    Scene(#[from] SceneError),
}
