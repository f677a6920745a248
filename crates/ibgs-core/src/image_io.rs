//! Writing pictures.

use crate::files::{WriteError, create_folder, write_atomically};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::io;
use std::path::Path;

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
