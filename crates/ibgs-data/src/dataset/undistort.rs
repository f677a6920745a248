//! Photos through a distorted lens become photos through a pinhole.
//!
//! The pinhole keeps focal length, principal point and size of the lens, so the pixels in the middle keep their
//! scale and nothing in the photo is enlarged. Where the pinhole looks past the photo's border the result is
//! transparent (alpha 0), and what lies outside the pinhole's frame is cropped. So a fisheye loses its rim: a pinhole of
//! its focal length and size shows 93 of 120 degrees, 115 of 180, and never more than 150 (see [`Lens::problem`]).

use super::Photo;
use super::lens::Lens;
use glam::DVec2;

/// An undistorted photo.
pub(crate) struct Undistorted {
    pub photo: Photo,
    /// 255 for pixels that have no source in the photo, 0 for the others.
    pub blank: Vec<u8>,
}

impl Undistorted {
    /// Share of the blank pixels.
    pub fn blank_share(&self) -> f64 {
        self.blank.iter().filter(|&&blank| blank > 0).count() as f64 / self.blank.len().max(1) as f64
    }
}

/// Resamples `photo`, taken through `lens`, with a Catmull-Rom kernel.
pub(crate) fn undistort(photo: &Photo, lens: &Lens) -> Undistorted {
    let size = DVec2::new(f64::from(lens.width), f64::from(lens.height));
    let reach = (lens.principal.abs() / lens.focal).max((size - lens.principal).abs() / lens.focal).length();
    let fold = lens.distortion.fold_radius(reach * 1.001);
    let mut rgba = Vec::with_capacity(photo.rgba.len());
    let mut blank = Vec::with_capacity(photo.rgba.len() / 4);
    for row in 0..photo.height {
        for column in 0..photo.width {
            let uv = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
            let ray = (uv - lens.principal) / lens.focal;
            let source = lens.distortion.distort(ray) * lens.focal + lens.principal;
            let inside = source.cmpge(DVec2::ZERO).all() && source.cmple(size).all();
            let shown = inside && ray.length() <= fold;
            rgba.extend(if shown { sample(photo, source) } else { [0; 4] });
            blank.push(if shown { 0 } else { u8::MAX });
        }
    }
    Undistorted { photo: Photo { width: photo.width, height: photo.height, rgba }, blank }
}

/// Catmull-Rom weights of the four samples around a fraction in `[0, 1)`.
fn weights(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t + 2.0 * t2 - t3), 0.5 * (2.0 - 5.0 * t2 + 3.0 * t3), 0.5 * (t + 4.0 * t2 - 3.0 * t3), 0.5 * (t3 - t2)]
}

/// Value at pixel coordinates `uv` (pixel centres at +0.5), border pixels repeated, colours weighted by alpha.
fn sample(photo: &Photo, uv: DVec2) -> [u8; 4] {
    let base = (uv - 0.5).floor();
    let fraction = uv - 0.5 - base;
    let (wx, wy) = (weights(fraction.x), weights(fraction.y));
    let index =
        |start: f64, step: usize, side: u32| (start as i64 + step as i64 - 1).clamp(0, i64::from(side) - 1) as usize;
    let columns: [usize; 4] = std::array::from_fn(|i| index(base.x, i, photo.width));
    let mut sum = [0.0_f64; 4];
    for (step, wy) in wy.iter().enumerate() {
        let row = index(base.y, step, photo.height) * photo.width as usize;
        for (column, wx) in columns.iter().zip(&wx) {
            let at = (row + column) * 4;
            let [r, g, b, a] = [0, 1, 2, 3].map(|c| f64::from(photo.rgba[at + c]));
            let w = wx * wy;
            for (sum, value) in sum.iter_mut().zip([r * a, g * a, b * a, a]) {
                *sum += w * value;
            }
        }
    }
    let [r, g, b, alpha] = sum;
    if alpha <= 0.0 {
        return [0; 4];
    }
    // `as u8` saturates, which clamps the kernel's overshoot.
    [r / alpha, g / alpha, b / alpha, alpha].map(|v| v.round() as u8)
}
