//! Features of a photo (Lowe, Distinctive Image Features from Scale-Invariant Keypoints, 2004).

use crate::dataset::Photo;
use glam::DVec2;
use image::imageops::{FilterType, resize};
use image::{ImageBuffer, Luma};
use lowe_sift::{DESCRIPTOR_LEN, GrayImage, Keypoint, Sift, SiftConfig};

/// Most places of a photo: those that stand out most.
const MOST: usize = 4000;
/// Photos that are longer are reduced; those that are not are searched at twice their size too.
const LONGEST: u32 = 1000;
/// Least contrast of a feature, of 1.
const CONTRAST: f32 = 0.01;
/// A feature's neighbourhood, in its scales, that a mask must not touch.
const REACH: f32 = 6.0;

/// Numbers of a feature that are compared, as bytes.
pub(super) type Descriptor = [u8; DESCRIPTOR_LEN];

/// Places of a photo that can be found in others.
#[derive(Debug, Default)]
pub(super) struct Features {
    /// In pixels.
    pub places: Vec<DVec2>,
    /// With the number of the place: it has several where it has no single direction.
    pub descriptors: Vec<(usize, Descriptor)>,
}

impl Features {
    pub fn of(photo: &Photo) -> Self {
        let longest = photo.width.max(photo.height);
        let size = [photo.width, photo.height];
        let reduced = size.map(|side| if longest > LONGEST { (side * LONGEST).div_ceil(longest) } else { side });
        let [width, height] = reduced.map(|side| side as usize);
        let Ok(image) = GrayImage::new(width, height, brightness(photo, reduced)) else { return Self::default() };
        let config =
            SiftConfig { contrast_threshold: CONTRAST, double_image: longest <= LONGEST, ..SiftConfig::default() };
        let Ok(sift) = Sift::new(config) else { return Self::default() };
        let mut found = sift.detect_and_compute(&image);
        let scale = DVec2::new(f64::from(size[0]), f64::from(size[1])) / DVec2::new(width as f64, height as f64);
        found.retain(|feature| is_shown(photo, &feature.keypoint, scale));
        found.sort_by(|a, b| b.keypoint.response.total_cmp(&a.keypoint.response));
        let mut features = Self::default();
        for feature in found {
            // Coordinates of the library name a pixel's centre by whole numbers.
            let at = (DVec2::new(f64::from(feature.keypoint.x), f64::from(feature.keypoint.y)) + 0.5) * scale;
            if features.places.last() != Some(&at) {
                if features.places.len() == MOST {
                    break;
                }
                features.places.push(at);
            }
            let bytes = feature.descriptor.as_slice().map(|value| (512.0 * value).min(255.0) as u8);
            features.descriptors.push((features.places.len() - 1, bytes));
        }
        features
    }
}

/// What is seen over black, reduced to a size: 0 to 1.
fn brightness(photo: &Photo, [width, height]: [u32; 2]) -> Vec<f32> {
    let gray = |&[r, g, b, a]: &[u8; 4]| {
        f32::from(a) * (0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b)) / (255.0 * 255.0)
    };
    let gray: Vec<f32> = photo.rgba.as_chunks().0.iter().map(gray).collect();
    match ImageBuffer::<Luma<f32>, _>::from_raw(photo.width, photo.height, gray) {
        Some(gray) if gray.dimensions() != (width, height) => {
            resize(&gray, width, height, FilterType::Triangle).into_raw()
        }
        Some(gray) => gray.into_raw(),
        None => Vec::new(),
    }
}

/// Whether no mask is near.
fn is_shown(photo: &Photo, keypoint: &Keypoint, scale: DVec2) -> bool {
    let reach = f64::from(REACH * keypoint.scale);
    let corners = [[0.0, 0.0], [-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]];
    corners.iter().all(|&corner| {
        let at = (DVec2::new(f64::from(keypoint.x), f64::from(keypoint.y)) + DVec2::from_array(corner) * reach) * scale;
        let [x, y] =
            [(at.x, photo.width), (at.y, photo.height)].map(|(at, size)| at.clamp(0.0, f64::from(size - 1)) as usize);
        photo.rgba[4 * (y * photo.width as usize + x) + 3] > 0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A photo of bright round spots on grey.
    fn spots(width: u32, height: u32, size: f64, at: &[DVec2]) -> Photo {
        let pixel = |i: u32| {
            let center = DVec2::new(f64::from(i % width), f64::from(i / width)) + 0.5;
            let bright: f64 = at.iter().map(|spot| (-center.distance_squared(*spot) / (2.0 * size * size)).exp()).sum();
            let value = (60.0 + 160.0 * bright).round() as u8;
            [value, value, value, 255]
        };
        Photo { width, height, rgba: (0..width * height).flat_map(pixel).collect() }
    }

    #[test]
    fn spots_are_found_where_they_are() {
        let at = [DVec2::new(40.3, 30.8), DVec2::new(70.9, 52.1)];
        let found = Features::of(&spots(110, 80, 3.0, &at));
        let miss = |spot: &DVec2| found.places.iter().map(|place| place.distance(*spot)).fold(f64::INFINITY, f64::min);
        assert!(at.iter().all(|spot| miss(spot) < 0.1), "{:?}", found.places);
        // A photo that is reduced for it.
        let at = [DVec2::new(400.3, 200.8), DVec2::new(1500.6, 331.2)];
        let found = Features::of(&spots(1800, 480, 9.0, &at));
        let miss = |spot: &DVec2| found.places.iter().map(|place| place.distance(*spot)).fold(f64::INFINITY, f64::min);
        assert!(at.iter().all(|spot| miss(spot) < 0.2), "{:?}", found.places);
    }

    #[test]
    fn nothing_is_found_at_a_mask_or_in_a_plain_photo() {
        let at = [DVec2::new(40.3, 30.8)];
        let mut photo = spots(110, 80, 3.0, &at);
        let near = |found: &Features| found.places.iter().any(|place| place.distance(at[0]) < 1.0);
        assert!(near(&Features::of(&photo)));
        for x in 52..58 {
            photo.rgba[4 * (42 * 110 + x) + 3] = 0;
        }
        (20..60).for_each(|y| (50..70).for_each(|x| photo.rgba[4 * (y * 110 + x) + 3] = 0));
        assert!(!near(&Features::of(&photo)));
        assert!(Features::of(&spots(64, 64, 3.0, &[])).places.is_empty());
        assert!(Features::of(&spots(2, 2, 3.0, &[])).places.is_empty());
    }
}
