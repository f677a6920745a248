//! Why options cannot be used.

use crate::files::WriteError;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Why options cannot be used.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the options file {}: {source}; check the path", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The file is not TOML, or has a field that is unknown or of the wrong kind.
    #[error("{}, line {line}: {reason}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// A value makes no sense.
    #[error("{}option `{field}` is {value}; {advice}", path.as_ref().map(|path| format!("{}: ", path.display())).unwrap_or_default())]
    Invalid {
        /// The file that it is from, if any.
        path: Option<PathBuf>,
        /// Path of the field as in the file, for instance `densify.interval`.
        field: String,
        /// The value.
        value: String,
        /// What it must be.
        advice: &'static str,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}
