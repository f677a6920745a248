//! Image metrics and the evaluation of a model (method.md section 9).

pub mod fit_pose;
pub mod fitted;
pub mod scores;
pub mod true_cameras;

pub use crate::score::Score;

use crate::camera::Camera;
use crate::dataset::{DatasetError, Photo, View};
use crate::files::WriteError;
use crate::gpu::GpuError;
use crate::output::pictures::RenderError;
use crate::render::{Frame, Rendered, Renderer};
use glam::{DMat3, DVec3};
use ibgs_shaders::{SSIM_C1, SSIM_C2, SSIM_RADIUS, ssim_window};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// An image and a photo that are compared, 8-bit RGB row by row. Where a photo's alpha is under one half it takes the
/// image's value.
pub struct Pair {
    /// The image.
    pub image: Vec<u8>,
    /// The photo.
    pub photo: Vec<u8>,
    /// Which pixels count.
    pub valid: Vec<bool>,
}

impl Pair {
    /// The two, for a metric.
    ///
    /// # Panics
    /// When the sizes differ: a bug of ours.
    pub fn new(image: &Rendered, photo: &Photo) -> Self {
        assert_eq!((image.width, image.height), (photo.width, photo.height), "image and photo differ in size");
        let rendered = image.to_rgb8();
        let mut given = rendered.clone();
        let valid: Vec<bool> = photo.rgba.chunks_exact(4).map(|y| y[3] >= 128).collect();
        let pixels = given.chunks_exact_mut(3).zip(photo.rgba.chunks_exact(4)).zip(&valid);
        for ((to, from), _) in pixels.filter(|(_, counts)| **counts) {
            to.copy_from_slice(&from[..3]);
        }
        Self { image: rendered, photo: given, valid }
    }
}

/// PSNR and SSIM of an image against a photo of the same size. Pixels whose alpha is under one half do not count: the
/// photo takes the image's value there, so that they do not disturb the windows of the pixels beside them. A photo that
/// is wholly masked ([`Photo::is_wholly_masked`]) equals every image, so its score means nothing.
///
/// # Panics
/// When the sizes differ: a bug of ours.
pub fn score(image: &Rendered, photo: &Photo) -> Score {
    let pair = Pair::new(image, photo);
    let plane = |rgb: &[u8], c: usize| rgb.chunks_exact(3).map(|p| f64::from(p[c]) / 255.0).collect::<Vec<f64>>();
    let planes = [0, 1, 2].map(|c| [plane(&pair.image, c), plane(&pair.photo, c)]);
    let (width, height) = (image.width as usize, image.height as usize);
    let ssim: f64 = planes.par_iter().map(|[a, b]| ssim_plane(a, b, &pair.valid, width, height)).sum();
    let aligned_psnr = psnr(&planes, &pair.valid, alignment(&planes, &pair.valid));
    let psnr = psnr(&planes, &pair.valid, (DMat3::IDENTITY, DVec3::ZERO));
    Score { psnr, aligned_psnr, ssim: ssim / 3.0, lpips: None }
}

/// An image's and a photo's values of each channel.
type Planes = [[Vec<f64>; 2]; 3];

/// Colours of the valid pixels.
fn colors<'a>(planes: &'a Planes, valid: &'a [bool]) -> impl Iterator<Item = [DVec3; 2]> + 'a {
    let color = move |i: usize, side: usize| DVec3::new(planes[0][side][i], planes[1][side][i], planes[2][side][i]);
    (0..valid.len()).filter(|&i| valid[i]).map(move |i| [color(i, 0), color(i, 1)])
}

/// PSNR in dB over the valid pixels after an affine map of the image's colours.
fn psnr(planes: &Planes, valid: &[bool], (map, offset): (DMat3, DVec3)) -> f64 {
    let mapped = |image: DVec3| (map * image + offset).clamp(DVec3::ZERO, DVec3::ONE);
    let error = |[image, photo]: [DVec3; 2]| (mapped(image) - photo).length_squared();
    let (squares, count) = colors(planes, valid).fold((0.0, 0), |(sum, count), pair| (sum + error(pair), count + 1));
    -10.0 * (squares / (3 * count.max(1)) as f64).log10()
}

/// The affine map of an image's colours to a photo's, by least squares; pulled slightly to the identity, for images of a
/// single colour.
fn alignment(planes: &Planes, valid: &[bool]) -> (DMat3, DVec3) {
    const RIDGE: f64 = 1e-8;
    let count = valid.iter().filter(|counts| **counts).count().max(1) as f64;
    let [image_mean, photo_mean] = colors(planes, valid)
        .fold([DVec3::ZERO; 2], |[a, b], [image, photo]| [a + image, b + photo])
        .map(|sum| sum / count);
    let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z) * (1.0 / count);
    let [own, cross] = colors(planes, valid).fold([DMat3::ZERO; 2], |[own, cross], [image, photo]| {
        let (image, photo) = (image - image_mean, photo - photo_mean);
        [own + outer(image, image), cross + outer(photo, image)]
    });
    let ridge = DMat3::IDENTITY * RIDGE;
    let map = (cross + ridge) * (own + ridge).inverse();
    (map, photo_mean - map * image_mean)
}

/// Squared errors summed over a part of several images rounded to 8 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Region {
    squares: f64,
    values: usize,
}

impl Region {
    /// Adds the pixels of an image that `inside` picks by their index; those whose alpha is under one half do not count.
    pub fn add(&mut self, image: &Rendered, photo: &Photo, inside: impl Fn(usize) -> bool) {
        let rendered = image.to_rgb8();
        for (i, (x, y)) in rendered.chunks_exact(3).zip(photo.rgba.chunks_exact(4)).enumerate() {
            if y[3] >= 128 && inside(i) {
                self.squares += (0..3).map(|c| (f64::from(x[c]) - f64::from(y[c])).powi(2)).sum::<f64>() / 65_025.0;
                self.values += 3;
            }
        }
    }

    /// PSNR in dB over everything added; none without anything.
    pub fn psnr(&self) -> Option<f64> {
        (self.values > 0).then(|| -10.0 * (self.squares / self.values as f64).log10())
    }
}

/// Separable windowed mean with zero padding.
fn blur(plane: &[f64], width: usize, height: usize) -> Vec<f64> {
    let window = ssim_window();
    let tap = |at: usize, k: usize, length: usize| (at + k).checked_sub(SSIM_RADIUS).filter(|&i| i < length);
    let mut rows = vec![0.0; plane.len()];
    for y in 0..height {
        for x in 0..width {
            rows[y * width + x] =
                (0..window.len()).filter_map(|k| tap(x, k, width).map(|i| window[k] * plane[y * width + i])).sum();
        }
    }
    let mut out = vec![0.0; plane.len()];
    for y in 0..height {
        for (k, weight) in window.iter().enumerate() {
            if let Some(i) = tap(y, k, height) {
                for x in 0..width {
                    out[y * width + x] += weight * rows[i * width + x];
                }
            }
        }
    }
    out
}

/// Mean over the valid pixels.
fn ssim_plane(a: &[f64], b: &[f64], valid: &[bool], width: usize, height: usize) -> f64 {
    let counted: Vec<usize> = (0..a.len()).filter(|i| valid[*i]).collect();
    if counted.is_empty() {
        return 1.0;
    }
    let product = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(x, y)| x * y).collect::<Vec<_>>();
    let jobs = [a.to_vec(), b.to_vec(), product(a, a), product(b, b), product(a, b)];
    let means: Vec<_> = jobs.par_iter().map(|p| blur(p, width, height)).collect();
    let (c1, c2) = (f64::from(SSIM_C1), f64::from(SSIM_C2));
    let sum: f64 = counted
        .iter()
        .map(|&i| {
            let [ma, mb, aa, bb, ab] = [0, 1, 2, 3, 4].map(|m| means[m][i]);
            let (va, vb, cov) = (aa - ma * ma, bb - mb * mb, ab - ma * mb);
            (2.0 * ma * mb + c1) * (2.0 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
        })
        .sum();
    sum / counted.len() as f64
}

/// Scores of one view: the base image's, and the final one's where the model has a network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewScores {
    /// The base image.
    pub base: Score,
    /// The final image.
    pub image: Option<Score>,
}

/// Why a model could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A photo cannot be decoded again.
    #[error(transparent)]
    Photo(#[from] DatasetError),
    /// A picture cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A distance of two images cannot be computed.
    #[error(transparent)]
    Distance(Box<dyn std::error::Error + Send + Sync>),
}

impl From<RenderError> for EvalError {
    fn from(error: RenderError) -> Self {
        match error {
            RenderError::Gpu(error) => Self::Gpu(error),
            RenderError::Write(error) => Self::Write(error),
        }
    }
}

/// A distance of an image from a photo that needs more than arithmetic, as LPIPS does.
pub trait Perceptual {
    /// Distance of an image rounded to 8 bits from a photo of the same size, 0 for equal ones.
    ///
    /// # Errors
    /// The images have no such distance, or the GPU failed.
    fn distance(&self, image: &Rendered, photo: &Photo) -> Result<f64, EvalError>;
}

/// Renders a view and compares its images with its photo; by a perceptual distance too where one is given.
///
/// # Errors
/// Not enough memory, the device is lost, or an image that has no perceptual distance.
pub fn score_view(
    renderer: &Renderer,
    view: &View,
    perceptual: Option<&dyn Perceptual>,
) -> Result<(Frame, ViewScores), EvalError> {
    let (frame, photo) = (renderer.render(&view.camera)?, view.photo.pixels()?);
    let scored = |image: &Rendered| {
        let lpips = perceptual.map(|metric| metric.distance(image, &photo)).transpose()?;
        Ok::<_, EvalError>(Score { lpips, ..score(image, &photo) })
    };
    let base = scored(&frame.base()?)?;
    let image = frame.image()?.as_ref().map(scored).transpose()?;
    Ok((frame, ViewScores { base, image }))
}

/// Least passes over the views when frames are counted.
pub const PASSES: u32 = 5;

/// What is kept from frame to frame when frames are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cache {
    /// Nothing: the sources' depth maps are rendered for every frame, as published figures have it.
    Cold,
    /// The sources' depth maps.
    Warm,
}

/// Frames a second over all views, repeated until there were [`PASSES`] and a second is over, the GPU finished before
/// the clock stops. Before that they are rendered for half a second, as GPUs that were idle run slower for a while.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn frames_per_second(renderer: &Renderer, cameras: &[Camera], cache: Cache) -> Result<f64, GpuError> {
    let until = |passes: u32, least: Duration| {
        let start = Instant::now();
        let mut done = 0;
        while done < passes || start.elapsed() < least {
            for camera in cameras {
                if cache == Cache::Cold {
                    renderer.forget_depths();
                }
                renderer.render_unchecked(camera)?;
            }
            renderer.gpu().wait()?;
            done += 1;
        }
        Ok(f64::from(done) * cameras.len() as f64 / start.elapsed().as_secs_f64())
    };
    // Checked, so that there is room for every intersection.
    for camera in cameras {
        renderer.render(camera)?;
    }
    until(1, Duration::from_millis(500))?;
    until(PASSES, Duration::from_secs(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: u32 = 48;

    /// A photo of noise, and an image that equals it on the left and is its negative on the right.
    fn half_right(alpha: impl Fn(usize) -> u8) -> (Rendered, Photo) {
        let noise = |i: usize| ((i * 7919 + i * i * 31) % 251) as u8;
        let pixels = (SIDE * SIDE) as usize;
        let rgba = (0..pixels).flat_map(|i| [noise(i), noise(i + 9), noise(i + 5), alpha(i)]).collect();
        let photo = Photo { width: SIDE, height: SIDE, rgba };
        let level = |i: usize, v: u8| f32::from(if i % SIDE as usize >= 24 { 255 - v } else { v }) / 255.0;
        let shown = photo.rgba.chunks_exact(4).enumerate();
        let rgb = shown.flat_map(|(i, p)| [level(i, p[0]), level(i, p[1]), level(i, p[2])]).collect();
        (Rendered { width: SIDE, height: SIDE, rgb }, photo)
    }

    #[test]
    fn masked_pixels_leave_both_figures() {
        let (image, photo) = half_right(|_| 255);
        let open = score(&image, &photo);
        // Without the right half nothing is wrong but for the windows that reach into it.
        let (_, left) = half_right(|i| if i % 48 < 24 { 255 } else { 127 });
        let good = score(&image, &left);
        assert!(good.psnr.is_infinite() && good.ssim == 1.0, "{good:?}");
        // Without the left half only what is wrong counts: both figures are worse, and not by chance.
        let (_, right) = half_right(|i| if i % 48 < 24 { 0 } else { 128 });
        let bad = score(&image, &right);
        assert!((bad.psnr - (open.psnr - 10.0 * 2f64.log10())).abs() < 1e-9, "{bad:?} {open:?}");
        assert!(bad.ssim < open.ssim - 0.5, "{bad:?} {open:?}");
        // What lies under a mask does not matter.
        let mut other = right.clone();
        other.rgba.chunks_exact_mut(4).filter(|p| p[3] == 0).for_each(|p| p[..3].copy_from_slice(&[1, 2, 3]));
        assert_eq!(score(&image, &other), bad);
        let (_, nothing) = half_right(|_| 0);
        assert_eq!(score(&image, &nothing).ssim, 1.0);
    }

    fn pair(change: impl Fn([f32; 3]) -> [f32; 3]) -> (Rendered, Photo) {
        let (width, height) = (24, 16);
        let color = |i: u32| [0.2 + 0.5 * ((i * 7) % 61) as f32 / 61.0, 0.3 + 0.3 * (i % 24) as f32 / 24.0, 0.4];
        let rgb: Vec<f32> = (0..width * height).flat_map(color).collect();
        let byte = |v: f32| (v * 255.0 + 0.5) as u8;
        let changed = rgb.chunks_exact(3).flat_map(|c| {
            let [r, g, b] = change([c[0], c[1], c[2]]).map(byte);
            [r, g, b, 255]
        });
        let photo = Photo { width, height, rgba: changed.collect() };
        (Rendered { width, height, rgb }, photo)
    }

    #[test]
    fn alignment_takes_an_affine_change_of_the_colours_back_and_nothing_else() {
        let (image, photo) = pair(|[r, g, b]| [1.2 * r + 0.03, 0.8 * g - 0.1 * r + 0.1, b + 0.2]);
        let scored = score(&image, &photo);
        // What remains is the rounding to 8 bits.
        assert!(scored.psnr < 25.0 && scored.aligned_psnr > 50.0, "{scored:?}");
        let (image, photo) = pair(|[r, g, b]| [(20.0 * r).sin().abs(), g, b]);
        let scored = score(&image, &photo);
        assert!(scored.aligned_psnr >= scored.psnr && scored.aligned_psnr < scored.psnr + 6.0, "{scored:?}");
        let flat = Rendered { rgb: vec![0.5; image.rgb.len()], ..image };
        let scored = score(&flat, &photo);
        assert!(scored.aligned_psnr.is_finite() && scored.aligned_psnr >= scored.psnr, "{scored:?}");
        let same = score(&flat, &Photo { rgba: vec![128; photo.rgba.len()], ..photo });
        assert_eq!(same.psnr, f64::INFINITY);
    }
}
