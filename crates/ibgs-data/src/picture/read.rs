//! Pictures of a model folder, read back.

use super::Picture;
use crate::image_io::decode;
use std::path::{Path, PathBuf};
use std::{fs, io};
use thiserror::Error;

/// Why a picture cannot be read.
#[derive(Debug, Error)]
#[error("cannot read the picture {}: {source}; render it again", path.display())]
pub struct ReadError {
    /// The file.
    path: PathBuf,
    /// What is wrong.
    source: io::Error,
}

/// Reads a picture of a model folder as 8-bit RGB; none where there is no such file.
///
/// # Errors
/// A file that cannot be read, or is no picture.
pub fn read_picture(path: &Path) -> Result<Option<Picture>, ReadError> {
    let bytes = match fs::read(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        read => read.map_err(|source| ReadError { path: path.to_owned(), source })?,
    };
    let image = decode(&bytes).map_err(|cause| ReadError { path: path.to_owned(), source: io::Error::other(cause) })?;
    let image = image.into_rgb8();
    Ok(Some(Picture { width: image.width(), height: image.height(), rgb: image.into_raw() }))
}
