//! The photos of a bundle: their parts, their encodings, and how they are made smaller.

use super::read::Parts;
use super::{Bundle, BundleError, Packing};
use crate::dataset::{DatasetError, HostPhoto, Photo, Resampler, resample};
use crate::image_io;
use crate::output::cameras::{CameraRecord, Split};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageFormat, ImageReader, RgbaImage};
use rayon::prelude::*;
use std::collections::HashMap;
use std::io::{self, Cursor, Read, Seek};
use std::sync::Arc;

/// Photos that are encoded at once.
pub(super) const BATCH: usize = 16;

/// Limit on the decoded size of all photos together: this many times the file's size, plus this many bytes. PNG shrinks
/// photos to a third and masked areas to almost nothing.
const MOST_TIMES: u64 = 256;
const MOST_BYTES_MORE: u64 = 1 << 30;

fn photo_part(name: &str) -> String {
    format!("photos/{name}.png")
}

fn small_photo_part(name: &str) -> String {
    format!("photos/{name}.jpg")
}

impl Bundle {
    /// Makes photos whose longest side has more than `longest` pixels smaller, together with their cameras.
    ///
    /// # Errors
    /// A photo cannot be decoded again.
    pub fn shrink_photos(&mut self, longest: u32) -> Result<(), DatasetError> {
        let is_large = |(_, photo): &&mut (String, HostPhoto)| photo.size().into_iter().any(|side| side > longest);
        self.photos.par_iter_mut().filter(is_large).try_for_each(|(_, photo)| {
            let Photo { width, height, rgba } = Arc::unwrap_or_clone(photo.pixels()?);
            let scale = f64::from(longest) / f64::from(width.max(height));
            let [w, h] = [width, height].map(|side| (scale * f64::from(side)).round().max(1.0) as u32);
            let image = RgbaImage::from_raw(width, height, rgba).expect("a photo has its size");
            let rgba = resample(image, w, h, Resampler::Lanczos3).into_raw();
            *photo = Photo { width: w, height: h, rgba }.into();
            Ok(())
        })?;
        let photos: HashMap<&str, [u32; 2]> =
            self.photos.iter().map(|(name, photo)| (name.as_str(), photo.size())).collect();
        for record in self.cameras.iter_mut().filter(|record| record.split == Some(Split::Train)) {
            let camera = &mut record.camera;
            if let Some(&[width, height]) = photos.get(record.name.as_str())
                && [width, height] != [camera.width, camera.height]
            {
                *camera = camera.resized(width, height);
            }
        }
        Ok(())
    }
}

impl<R: Read + Seek> Parts<'_, R> {
    /// The training views' photos, in the order of the cameras.
    pub(super) fn photos(&mut self, cameras: &[CameraRecord]) -> Result<Vec<(String, HostPhoto)>, BundleError> {
        let mut photos = Vec::new();
        let training: Vec<&CameraRecord> = cameras.iter().filter(|c| c.split == Some(Split::Train)).collect();
        let sizes = training.iter().map(|c| u64::from(c.camera.width).saturating_mul(4 * u64::from(c.camera.height)));
        let needed = sizes.fold(0_u64, u64::saturating_add);
        if needed / MOST_TIMES > self.zip.length().saturating_add(MOST_BYTES_MORE / MOST_TIMES) {
            let reason =
                format!("asks for {needed} bytes of photos, which a file of {} bytes cannot hold", self.zip.length());
            return Err(self.damaged("cameras.json", reason));
        }
        for batch in training.chunks(BATCH) {
            let read = batch.iter().map(|record| {
                let small = small_photo_part(&record.name);
                let (part, format) = match self.zip.has(&small) {
                    true => (small, ImageFormat::Jpeg),
                    false => (photo_part(&record.name), ImageFormat::Png),
                };
                Ok((self.bytes(&part)?, format, part))
            });
            let read = read.collect::<Result<Vec<_>, BundleError>>()?;
            let decode =
                |(record, (bytes, format, _)): (&&CameraRecord, &(Vec<u8>, _, _))| decode(bytes, *format, record);
            let decoded: Vec<_> = batch.par_iter().zip(&read).map(decode).collect();
            for ((record, (_, _, part)), photo) in batch.iter().zip(&read).zip(decoded) {
                let photo = photo.map_err(|reason| self.damaged(part, reason))?;
                photos.push((record.name.clone(), photo.into()));
            }
        }
        Ok(photos)
    }
}

/// A photo's part of the archive, by name and contents. JPEG has no transparency.
pub(super) fn encode(name: &str, photo: &Photo, packing: Packing) -> io::Result<(String, Vec<u8>)> {
    let mut bytes = Vec::new();
    let opaque = photo.rgba.chunks_exact(4).all(|pixel| pixel[3] == u8::MAX);
    let (width, height) = (photo.width, photo.height);
    let rgb = || -> Vec<u8> { photo.rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect() };
    let (part, written) = match packing {
        Packing::Small { photo_quality } if opaque => {
            let encoder = JpegEncoder::new_with_quality(&mut bytes, photo_quality);
            (small_photo_part(name), encoder.write_image(&rgb(), width, height, ExtendedColorType::Rgb8))
        }
        _ if opaque => {
            let encoder = PngEncoder::new(&mut bytes);
            (photo_part(name), encoder.write_image(&rgb(), width, height, ExtendedColorType::Rgb8))
        }
        _ => {
            let encoder = PngEncoder::new(&mut bytes);
            (photo_part(name), encoder.write_image(&photo.rgba, width, height, ExtendedColorType::Rgba8))
        }
    };
    written.map_err(io::Error::other)?;
    Ok((part, bytes))
}

/// The photo of a camera, or what is wrong with it.
fn decode(bytes: &[u8], format: ImageFormat, record: &CameraRecord) -> Result<Photo, String> {
    // Before the pixels are decoded.
    let reader = ImageReader::with_format(Cursor::new(bytes), format);
    let (width, height) = reader.into_dimensions().map_err(|error| format!("is no usable picture ({error})"))?;
    let camera = &record.camera;
    if (width, height) != (camera.width, camera.height) {
        return Err(format!("has {width} x {height} pixels, its camera {} x {}", camera.width, camera.height));
    }
    let image = image_io::decode(bytes).map_err(|reason| format!("is no usable picture ({reason})"))?;
    let rgba = image.into_rgba8().into_raw();
    Ok(Photo { width, height, rgba })
}
