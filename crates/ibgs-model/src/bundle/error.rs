//! Errors of bundles.

use super::ENSEMBLE_FORMAT;
use crate::files::WriteError;
use crate::scene::SceneError;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Why a bundle cannot be read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BundleError {
    /// The file cannot be opened.
    #[error("cannot read the bundle {}: {source}; check the path", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The file is something else, or its end is missing.
    #[error("{} is no whole `.ibgs` bundle ({reason}); check the path, copy or export it again", path.display())]
    NoBundle {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A part of the bundle is missing or broken.
    #[error("the bundle {} is damaged: its `{part}` {reason}; copy or export it again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Name inside the bundle.
        part: String,
        /// What is wrong.
        reason: String,
    },
    /// A later version wrote it.
    #[error("the bundle {} has format {found}, this version of ibgs reads {ENSEMBLE_FORMAT}; use a newer one", path.display())]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
    },
    /// The Gaussians are not valid.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Writing failed.
    #[error(transparent)]
    Write(#[from] WriteError),
}
