//! Writing pictures, and reading them back.

use crate::files::{WriteError, create_folder, write_atomically};
use crate::picture::Picture;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a picture cannot be read.
#[derive(Debug, Error)]
#[error("cannot read the picture {}: {source}; render it again", path.display())]
pub struct ReadError {
    /// The file.
    path: PathBuf,
    /// What is wrong.
    source: image::ImageError,
}

/// Writes an 8-bit RGB picture as PNG in one atomic step, folders included.
///
/// # Errors
/// When the file cannot be written.
pub fn write_png(path: &Path, width: u32, height: u32, rgb: &[u8]) -> Result<(), WriteError> {
    if let Some(folder) = path.parent() {
        create_folder(folder)?;
    }
    write_atomically(path, |out| {
        let encoder = PngEncoder::new(out);
        encoder.write_image(rgb, width, height, ExtendedColorType::Rgb8).map_err(io::Error::other)
    })
}

/// Reads a picture of a model folder as 8-bit RGB; none where there is no such file.
///
/// # Errors
/// A file that cannot be read, or is no picture.
pub fn read_picture(path: &Path) -> Result<Option<Picture>, ReadError> {
    if !path.exists() {
        return Ok(None);
    }
    let image = image::open(path).map_err(|source| ReadError { path: path.to_owned(), source })?.into_rgb8();
    Ok(Some(Picture { width: image.width(), height: image.height(), rgb: image.into_raw() }))
}
