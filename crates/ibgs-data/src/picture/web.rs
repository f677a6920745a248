//! Pictures for pages: errors in colours, and pictures as part of a page's text.

use super::Picture;
use crate::dataset::Photo;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use colorous::INFERNO;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::{FilterType, resize};
use image::{ImageError, RgbImage};

/// The error that the brightest colour of an error picture stands for, as a part of the whole range 0..1.
pub const WORST: f64 = 0.2;
/// Quality of JPEG pictures, of 100.
const QUALITY: u8 = 88;

/// A colour of error pictures, 0 the least and 1 the largest error.
pub fn error_color(t: f64) -> [u8; 3] {
    let color = INFERNO.eval_continuous(t.clamp(0.0, 1.0));
    [color.r, color.g, color.b]
}

impl Picture {
    /// A photo's colours.
    pub fn photo(photo: &Photo) -> Self {
        let rgb = photo.rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        Self { width: photo.width, height: photo.height, rgb }
    }

    /// Mean absolute error over a pixel's channels, black for none and brightest from [`WORST`] on. Pixels that do not
    /// count (alpha under one half) are black. None where the sizes differ.
    pub fn error(&self, photo: &Photo) -> Option<Self> {
        if [self.width, self.height] != [photo.width, photo.height] {
            return None;
        }
        let color = |(a, b): (&[u8], &[u8])| {
            let sum: u32 = (0..3).map(|c| u32::from(a[c].abs_diff(b[c]))).sum();
            let sum = if b[3] < 128 { 0 } else { sum };
            error_color(f64::from(sum) / (3.0 * 255.0 * WORST))
        };
        let rgb = self.rgb.chunks_exact(3).zip(photo.rgba.chunks_exact(4)).flat_map(color).collect();
        Some(Self { width: self.width, height: self.height, rgb })
    }

    /// What this image has more than another one, around grey and twice as strong. None where the sizes differ.
    pub fn gain(&self, base: &Picture) -> Option<Self> {
        if [self.width, self.height] != [base.width, base.height] {
            return None;
        }
        let value = |(&a, &b): (&u8, &u8)| (128 + 2 * (i16::from(a) - i16::from(b))).clamp(0, 255) as u8;
        let rgb = self.rgb.iter().zip(&base.rgb).map(value).collect();
        Some(Self { width: self.width, height: self.height, rgb })
    }

    /// The picture as a `data:` address of a JPEG, made smaller until no side is longer than `most` pixels.
    ///
    /// # Errors
    /// A picture of no size or of more than 65,535 pixels a side.
    pub fn data_uri(&self, most: u32) -> Result<String, ImageError> {
        let rgb = RgbImage::from_raw(self.width, self.height, self.rgb.clone()).expect("width * height * 3 bytes");
        let scale = f64::from(most) / f64::from(self.width.max(self.height).max(1));
        let side = |length: u32| ((f64::from(length) * scale).round() as u32).max(1);
        let small = match scale < 1.0 {
            true => resize(&rgb, side(self.width), side(self.height), FilterType::Triangle),
            false => rgb,
        };
        let mut jpeg = Vec::new();
        small.write_with_encoder(JpegEncoder::new_with_quality(&mut jpeg, QUALITY))?;
        Ok(format!("data:image/jpeg;base64,{}", BASE64_STANDARD.encode(jpeg)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_and_gains() {
        let picture = |rgb: &[u8]| Picture { width: 2, height: 1, rgb: rgb.to_vec() };
        let photo = Photo { width: 2, height: 1, rgba: vec![0, 0, 0, 255, 0, 0, 0, 100] };
        let error = picture(&[51, 51, 51, 200, 200, 200]).error(&photo).unwrap();
        // A fifth of the range is the worst; a masked pixel does not count.
        assert_eq!(error.rgb, [error_color(1.0), error_color(0.0)].concat());
        let gain = picture(&[10, 20, 200, 0, 0, 255]).gain(&picture(&[10, 10, 0, 255, 1, 0])).unwrap();
        assert_eq!(gain.rgb, [128, 148, 255, 0, 126, 255]);
        let other = Photo { width: 1, height: 2, ..photo };
        assert!(picture(&[0; 6]).error(&other).is_none());
    }

    #[test]
    fn data_uris_hold_the_picture_made_smaller() {
        let picture = Picture { width: 300, height: 150, rgb: vec![90; 3 * 300 * 150] };
        for (most, size) in [(1000, (300, 150)), (100, (100, 50))] {
            let uri = picture.data_uri(most).unwrap();
            let bytes = BASE64_STANDARD.decode(uri.strip_prefix("data:image/jpeg;base64,").unwrap()).unwrap();
            let image = image::load_from_memory(&bytes).unwrap().into_rgb8();
            assert_eq!(image.dimensions(), size);
            assert!(image.iter().all(|v| v.abs_diff(90) <= 2));
        }
        assert!(Picture { width: 0, height: 0, rgb: Vec::new() }.data_uri(10).is_err());
    }
}
