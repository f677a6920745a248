//! Photos whose pixels EXIF asks viewers to turn. COLMAP and training use pixels as a file stores them, so a scene gets
//! such photos with their pixels turned.

use anyhow::{Result, bail};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::codecs::tiff::TiffEncoder;
use image::codecs::webp::WebPEncoder;
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageEncoder, ImageFormat, ImageReader, ImageResult};
use std::fs::File;
use std::io::{BufReader, Cursor};
use std::path::Path;

/// JPEG quality of a turned photo: no loss that training could see.
const QUALITY: u8 = 98;

fn reader(path: &Path) -> Result<ImageReader<BufReader<File>>> {
    Ok(ImageReader::open(path)?.with_guessed_format()?)
}

/// Whether EXIF asks to turn or mirror the pixels of a photo; not of one that cannot be read.
pub(super) fn asks_to_turn(path: &Path) -> bool {
    let decoder = reader(path).ok().and_then(|reader| reader.into_decoder().ok());
    let orientation = decoder.and_then(|mut decoder| decoder.orientation().ok());
    orientation.is_some_and(|orientation| orientation != Orientation::NoTransforms)
}

/// The contents of a photo's file with its pixels turned as EXIF asks, in its own format, with its other metadata:
/// COLMAP reads the focal length there.
///
/// # Errors
/// The photo does not decode, or has a format that is not written.
pub(super) fn upright(path: &Path) -> Result<Vec<u8>> {
    let reader = reader(path)?;
    let format = reader.format();
    let mut decoder = reader.into_decoder()?;
    let orientation = decoder.orientation()?;
    let metadata = Metadata { exif: decoder.exif_metadata()?, color: decoder.icc_profile()? };
    let mut image = DynamicImage::from_decoder(decoder)?;
    image.apply_orientation(orientation);
    let mut file = Cursor::new(Vec::new());
    let written = match format {
        Some(ImageFormat::Jpeg) => metadata.write(&image, JpegEncoder::new_with_quality(&mut file, QUALITY)),
        Some(ImageFormat::Png) => metadata.write(&image, PngEncoder::new(&mut file)),
        Some(ImageFormat::Tiff) => metadata.write(&image, TiffEncoder::new(&mut file)),
        Some(ImageFormat::WebP) => metadata.write(&image, WebPEncoder::new_lossless(&mut file)),
        _ => bail!("its format is not written"),
    };
    written?;
    Ok(file.into_inner())
}

/// What a photo says beside its pixels.
struct Metadata {
    exif: Option<Vec<u8>>,
    color: Option<Vec<u8>>,
}

impl Metadata {
    /// Writes a turned photo; a format without a place for metadata goes without.
    fn write(self, image: &DynamicImage, mut encoder: impl ImageEncoder) -> ImageResult<()> {
        if let Some(mut exif) = self.exif {
            let _ = Orientation::remove_from_exif_chunk(&mut exif);
            let _ = encoder.set_exif_metadata(exif);
        }
        if let Some(color) = self.color {
            let _ = encoder.set_icc_profile(color);
        }
        image.write_with_encoder(encoder)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage};

    /// A TIFF header with one entry: the orientation.
    fn exif(orientation: u8) -> Vec<u8> {
        [&b"MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0"[..], &[orientation], &[0; 6]].concat()
    }

    fn with_exif(mut encoder: impl ImageEncoder, orientation: u8, photo: &DynamicImage) {
        encoder.set_exif_metadata(exif(orientation)).unwrap();
        photo.write_with_encoder(encoder).unwrap();
    }

    #[test]
    fn every_orientation_becomes_the_first() {
        let folder = tempfile::tempdir().unwrap();
        // Another colour in each quarter.
        let level = |is_first: bool| if is_first { 250 } else { 50 };
        let photo = RgbImage::from_fn(32, 16, |x, y| Rgb([level(x < 16), 0, level(y < 8)]));
        let photo = DynamicImage::from(photo);
        for (orientation, name) in (1..=8).flat_map(|turn| ["a.jpg", "a.png", "a.webp"].map(|name| (turn, name))) {
            let path = folder.path().join(name);
            let mut file = Cursor::new(Vec::new());
            match name {
                "a.jpg" => with_exif(JpegEncoder::new_with_quality(&mut file, 100), orientation, &photo),
                "a.png" => with_exif(PngEncoder::new(&mut file), orientation, &photo),
                _ => with_exif(WebPEncoder::new_lossless(&mut file), orientation, &photo),
            }
            std::fs::write(&path, file.into_inner()).unwrap();
            assert_eq!(asks_to_turn(&path), orientation != 1, "{name} {orientation}");
            let bytes = upright(&path).unwrap();
            std::fs::write(&path, &bytes).unwrap();
            assert!(!asks_to_turn(&path), "{name} {orientation}");
            let mut expected = photo.clone();
            expected.apply_orientation(Orientation::from_exif(orientation).unwrap());
            let (shown, expected) = (image::load_from_memory(&bytes).unwrap().into_rgb8(), expected.into_rgb8());
            assert_eq!(shown.dimensions(), expected.dimensions());
            let worst = shown.iter().zip(expected.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
            assert!(worst <= 6, "{name} {orientation}: {worst} levels");
            let kept = reader(&path).unwrap().into_decoder().unwrap().exif_metadata().unwrap();
            assert!(kept.is_some(), "{name}: other metadata stay");
        }
    }
}
