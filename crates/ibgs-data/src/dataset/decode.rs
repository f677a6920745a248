//! From a photo's file to 8-bit RGBA: decoding, colour space, alpha, masks.

use super::error::{DatasetError, read_bytes};
use super::masks::check_shape;
use super::{ColorSpace, LoadOptions, Photo};
use crate::image_io;
use exr::meta::MetaData;
use exr::prelude::{ReadChannels, ReadLayers, RgbaChannels, Vec2, read};
use image::imageops::{self, FilterType};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Rgba, Rgba32FImage, RgbaImage};
use std::io::{BufReader, Cursor, Read};
use std::path::Path;

const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
/// Longest side and most pixels of an EXR photo, and the largest factor by which its compressions shrink the values.
/// Without such limits a header of a few bytes could claim any size.
const EXR_SIDE: usize = 65_535;
const EXR_PIXELS: usize = 1 << 28;
const EXR_TIMES: usize = 1400;
/// Bytes that a block of lines, or a tile, may take even if the values take less.
const EXR_BLOCK: usize = 1 << 25;
/// A frame around the values may have this many pixels (4K), or this many times theirs.
const EXR_FRAME_PIXELS: usize = 4096 * 2160;
const EXR_FRAME_TIMES: usize = 16;

/// Width and height in a photo's header; its contents tell its format.
///
/// # Errors
/// [`DatasetError`] naming the file, where it is no photo that is read.
pub fn photo_size(path: &Path) -> Result<(u32, u32), DatasetError> {
    header(path).map(|header| header.size)
}

/// What a photo says before its pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Header {
    /// Width and height as the file stores the pixels.
    pub size: (u32, u32),
    /// EXIF asks viewers to turn or mirror the pixels.
    pub is_turned: bool,
}

/// As [`photo_size`], with the orientation.
pub(crate) fn header(path: &Path) -> Result<Header, DatasetError> {
    let unreadable = |cause: std::io::Error| DatasetError::read(path, &cause);
    let broken = |cause: String| DatasetError::Photo { path: path.to_owned(), cause };
    let mut file = BufReader::new(std::fs::File::open(path).map_err(unreadable)?);
    let mut start = Vec::new();
    file.by_ref().take(UNREAD_START).read_to_end(&mut start).map_err(unreadable)?;
    if let Some(unread) = unread_format(path, &start) {
        return Err(unread);
    }
    if start.starts_with(&EXR_MAGIC) {
        let meta = MetaData::read_from_file(path, false).map_err(|cause| broken(cause.to_string()))?;
        let length = std::fs::metadata(path).map_err(unreadable)?.len() as usize;
        let Vec2(width, height) = exr_size(&meta, length).map_err(broken)?;
        return Ok(Header { size: (width as u32, height as u32), is_turned: false });
    }
    let reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format).map_err(unreadable)?;
    let mut decoder = reader.into_decoder().map_err(|cause| broken(cause.to_string()))?;
    Ok(Header { size: decoder.dimensions(), is_turned: asks_to_turn(&mut decoder) })
}

/// Whether the EXIF orientation of a photo's contents asks to turn or mirror its pixels.
pub(crate) fn is_turned(bytes: &[u8]) -> bool {
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    reader.is_ok_and(|reader| reader.into_decoder().is_ok_and(|mut decoder| asks_to_turn(&mut decoder)))
}

fn asks_to_turn(decoder: &mut impl ImageDecoder) -> bool {
    decoder.orientation().is_ok_and(|orientation| orientation != Orientation::NoTransforms)
}

/// As many bytes of a file tell its format.
const UNREAD_START: u64 = 64;

/// An error for photos of phones and cameras in formats without a decoder in Rust, by the start of the file.
fn unread_format(path: &Path, bytes: &[u8]) -> Option<DatasetError> {
    let start = &bytes[..bytes.len().min(UNREAD_START as usize)];
    let has_brand = |brands: &[&[u8]]| start.chunks(4).skip(2).any(|brand| brands.contains(&brand));
    let is_media = start.get(4..8) == Some(b"ftyp");
    let is_jxl = start.starts_with(b"\xff\x0a") || start.starts_with(b"\0\0\0\x0cJXL ");
    let (format, converter) = if is_media && has_brand(&[b"avif", b"avis"]) {
        ("AVIF", "avifdec")
    } else if is_media && has_brand(&[b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"]) {
        ("HEIC", "heif-convert")
    } else if is_jxl {
        ("JPEG XL", "djxl")
    } else {
        return None;
    };
    Some(DatasetError::PhotoFormat { path: path.to_owned(), format, converter })
}

/// Decodes the contents of a PNG, JPEG, WebP, TIFF or EXR photo as a scene's photos are, before undistortion and resizing; `path` is
/// for messages.
///
/// # Errors
/// [`DatasetError::Photo`] for contents that are none of these, damaged, or larger than their bytes can hold;
/// [`DatasetError::PhotoFormat`] for a known format that is not read.
pub fn decode_photo(path: &Path, bytes: &[u8], options: &LoadOptions) -> Result<Photo, DatasetError> {
    let image = decode(path, bytes, options)?;
    Ok(Photo { width: image.width(), height: image.height(), rgba: image.into_raw() })
}

/// Decodes to 8-bit RGBA. EXIF orientation is ignored: poses and intrinsics refer to the pixels as stored.
pub(crate) fn decode(path: &Path, bytes: &[u8], options: &LoadOptions) -> Result<RgbaImage, DatasetError> {
    let (image, usual) = decode_any(path, bytes)?;
    let linear = options.color_space.unwrap_or(usual) == ColorSpace::Linear;
    if !linear {
        // Rounds to the nearest of 256 levels, also from 16 bits and floats.
        return Ok(image.into_rgba8());
    }
    let mut image = image.into_rgba32f();
    for Rgba([r, g, b, _]) in image.pixels_mut() {
        [r, g, b].into_iter().for_each(|color| *color = srgb(*color));
    }
    Ok(DynamicImage::from(image).into_rgba8())
}

/// What a mask does to the alpha of the pixels that it drops.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Drops {
    /// Lowers it to the mask's brightness.
    ByBrightness,
    /// Sets it to 0 where the mask is darker than one half: there is no photo.
    Photo,
}

/// Lowers alpha where a mask is dark (white keeps, black drops); masks of another size are resized. The first path is the photo's,
/// for messages.
///
/// # Errors
/// The mask does not decode, or has another shape than the photo.
pub(crate) fn apply_mask(
    photo: &mut RgbaImage,
    (path, mask_path): (&Path, &Path),
    drops: Drops,
) -> Result<(), DatasetError> {
    let mask = decode_any(mask_path, &read_bytes(mask_path)?)?.0.into_luma8();
    let (width, height) = photo.dimensions();
    check_shape((mask_path, mask.dimensions()), (path, (width, height)))?;
    let mask = if mask.dimensions() == (width, height) {
        mask
    } else {
        imageops::resize(&mask, width, height, FilterType::Triangle)
    };
    for (pixel, keep) in photo.pixels_mut().zip(mask.pixels()) {
        match drops {
            Drops::ByBrightness => pixel.0[3] = pixel.0[3].min(keep.0[0]),
            Drops::Photo if keep.0[0] < 128 => pixel.0[3] = 0,
            Drops::Photo => {}
        }
    }
    Ok(())
}

/// Decodes a whole file; and the colour space that its format usually has.
fn decode_any(path: &Path, bytes: &[u8]) -> Result<(DynamicImage, ColorSpace), DatasetError> {
    let refuse = |cause: String| DatasetError::Photo { path: path.to_owned(), cause };
    if bytes.starts_with(&EXR_MAGIC) {
        return Ok((decode_exr(bytes).map_err(refuse)?.into(), ColorSpace::Linear));
    }
    if let Some(unread) = unread_format(path, bytes) {
        return Err(unread);
    }
    // The JPEG decoder fills what is missing with grey and says nothing.
    if image::guess_format(bytes).ok() == Some(ImageFormat::Jpeg) && !jpeg_is_whole(bytes) {
        return Err(refuse("the JPEG data ends early".to_owned()));
    }
    Ok((image_io::decode(bytes).map_err(refuse)?, ColorSpace::Srgb))
}

/// Walks the segments of a JPEG file up to its end marker; what follows is ignored.
fn jpeg_is_whole(bytes: &[u8]) -> bool {
    const START: u8 = 0xd8;
    const END: u8 = 0xd9;
    let mut rest = bytes;
    // In compressed data 0xff is followed by 0 or a restart marker, so looking for 0xff also skips a scan.
    while let Some(at) = rest.iter().position(|byte| *byte == 0xff) {
        rest = &rest[at + 1..];
        match rest {
            [END, ..] => return true,
            [0x00 | 0x01 | 0xff | START | 0xd0..=0xd7, ..] => {}
            [_, high, low, ..] => {
                let length = usize::from(u16::from_be_bytes([*high, *low]));
                rest = rest.get(1 + length..).unwrap_or_default();
            }
            _ => return false,
        }
    }
    false
}

/// Linear light to sRGB, both 1 at white.
pub(crate) fn srgb(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Size of the picture, which is the display window, of a file of this many bytes.
fn exr_size(meta: &MetaData, length: usize) -> Result<Vec2<usize>, String> {
    let header = meta.headers.first().ok_or("it has no layer")?;
    let sizes = meta.headers.iter().map(|header| header.layer_size);
    let display = header.shared_attributes.display_window.size;
    for Vec2(width, height) in sizes.chain([display]) {
        let small = width <= EXR_SIDE && height <= EXR_SIDE && width * height <= EXR_PIXELS;
        if !small || width == 0 || height == 0 {
            return Err(format!("a size of {width} x {height} pixels makes no sense"));
        }
    }
    if meta.headers.iter().any(|header| header.deep) {
        return Err("deep data is not supported".to_owned());
    }
    for header in &meta.headers {
        let Vec2(width, height) = header.layer_size;
        let values = (width * height).saturating_mul(header.channels.bytes_per_pixel);
        if values / EXR_TIMES > length {
            return Err(format!("its header promises {width} x {height} pixels, which its {length} bytes cannot hold"));
        }
    }
    for header in &meta.headers {
        let bytes = header.channels.bytes_per_pixel;
        let Vec2(width, height) = header.max_block_pixel_size();
        let block = width.saturating_mul(height).saturating_mul(bytes);
        if block > EXR_BLOCK.max(header.layer_size.area().saturating_mul(bytes)) {
            return Err(format!("blocks of {width} x {height} pixels make no sense"));
        }
    }
    let largest = meta.headers.iter().map(|header| header.layer_size.area()).max().unwrap_or_default();
    if display.area() > EXR_FRAME_PIXELS.max(EXR_FRAME_TIMES * largest) {
        let Vec2(width, height) = display;
        return Err(format!("a frame of {width} x {height} pixels around {largest} makes no sense"));
    }
    Ok(display)
}

/// The first layer with channels R, G and B, as values in its own colour space with straight alpha (OpenEXR multiplies
/// colours by it); transparent where the data window leaves a part of the display window out.
fn decode_exr(bytes: &[u8]) -> Result<Rgba32FImage, String> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|cause| cause.to_string())?;
    let Vec2(width, height) = exr_size(&meta, bytes.len())?;
    let create = |size: Vec2<usize>, _: &RgbaChannels| Rgba32FImage::new(size.0 as u32, size.1 as u32);
    let set = |image: &mut Rgba32FImage, at: Vec2<usize>, (r, g, b, a): (f32, f32, f32, f32)| {
        // NaN becomes black, and black stays where nothing is opaque.
        let straight = |color: f32| if color.is_nan() || a <= 0.0 { 0.0 } else { color / a };
        let pixel = [straight(r), straight(g), straight(b), if a > 0.0 { a.min(1.0) } else { 0.0 }];
        image.put_pixel(at.0 as u32, at.1 as u32, Rgba(pixel));
    };
    let reader = read().no_deep_data().largest_resolution_level().rgba_channels(create, set);
    let whole = reader.first_valid_layer().all_attributes().from_buffered(Cursor::new(bytes));
    let whole = whole.map_err(|cause| cause.to_string())?;
    let offset = whole.layer_data.attributes.layer_position - whole.attributes.display_window.position;
    let pixels = whole.layer_data.channel_data.pixels;
    let (width, height) = (width as u32, height as u32);
    if offset == Vec2(0, 0) && pixels.dimensions() == (width, height) {
        return Ok(pixels);
    }
    let mut shown = Rgba32FImage::new(width, height);
    imageops::replace(&mut shown, &pixels, i64::from(offset.0), i64::from(offset.1));
    Ok(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_srgb_curve_has_its_known_values() {
        // From IEC 61966-2-1: middle grey, the joint of the two parts, the ends.
        for (linear, encoded) in [(0.0, 0.0), (0.002, 0.025_84), (0.003_130_8, 0.040_45), (0.214_041, 0.5), (1.0, 1.0)]
        {
            assert!((srgb(linear) - encoded).abs() < 1e-5, "{linear}: {} for {encoded}", srgb(linear));
        }
    }
}
