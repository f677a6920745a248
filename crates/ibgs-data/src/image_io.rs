//! Encoding and decoding of pictures.

use crate::files::{WriteError, create_folder, write_atomically};
use image::codecs::png::PngEncoder;
use image::{DynamicImage, ExtendedColorType, ImageEncoder, ImageError, ImageFormat, ImageReader};
use std::io::{self, Cursor};
use std::path::Path;

/// Most pixels in a byte of a file: deflate shrinks to a 1032nd at best, and a pixel of a PNG or TIFF may be one bit; a JPEG
/// has at least one bit for a block of 8 x 8, and a lossy WebP three for one of 16 x 16.
const DEFLATED_PIXELS: u64 = 8 * 1032;
const JPEG_PIXELS: u64 = 1024;
/// Pixels that a lossless WebP, such as a white mask, may have in next to no bytes.
const WEBP_FREE_PIXELS: u64 = 1 << 25;

/// Decodes the contents of a PNG, JPEG, WebP or TIFF file, or says what is wrong with it. A header can promise any size: no memory
/// is reserved for more pixels than the file's bytes can hold.
pub fn decode(bytes: &[u8]) -> Result<DynamicImage, String> {
    let reader = || ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|cause| cause.to_string());
    let (width, height) = reader()?.into_dimensions().map_err(|cause| cause.to_string())?;
    if width == 0 || height == 0 {
        return Err("it has no pixels".to_owned());
    }
    let (each, free) = match reader()?.format() {
        Some(ImageFormat::Jpeg) => (JPEG_PIXELS, 0),
        Some(ImageFormat::WebP) => (JPEG_PIXELS, WEBP_FREE_PIXELS),
        _ => (DEFLATED_PIXELS, 0),
    };
    if u64::from(width) * u64::from(height) > free + each * bytes.len() as u64 {
        let length = bytes.len();
        return Err(format!("its header promises {width} x {height} pixels, which its {length} bytes cannot hold"));
    }
    reader()?.decode().map_err(|cause| match cause {
        ImageError::Limits(_) => format!("its {width} x {height} pixels take more than 512 MiB"),
        cause => cause.to_string(),
    })
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
