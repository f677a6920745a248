//! The pose of a camera that fits its photo best, by Gauss-Newton steps. Derivatives are differences between renders, so the model is
//! only rendered, never trained.

use crate::camera::Camera;
use crate::camera_change::CameraChange;
use crate::cholesky::Symmetric;
use crate::dataset::Photo;
use crate::gpu::GpuError;
use crate::render::Renderer;
use ibgs_data::median;

/// Parts of the size, coarse to fine, and the shortest side in pixels that an image needs.
const FACTORS: [u32; 2] = [4, 2];
const LEAST_SIDE: u32 = 32;
/// Steps at a size, and how often one that makes the image worse is shortened.
const STEPS: usize = 8;
const TRIES: usize = 3;
/// Movement in the image, in pixels, of the differences; and below which a step is the last.
const DIFFERENCE: f64 = 0.5;
const SMALLEST: f64 = 0.005;
/// Damping at first, as a part of the diagonal, and its change after a step that was taken and one that was not.
const DAMPING: f64 = 1e-3;
const DAMPING_CHANGE: [f64; 2] = [0.2, 10.0];
/// Errors beyond as many times the median count less, at least those beyond this one.
const ROBUST: f64 = 1.5;
const LEAST_SCALE: f64 = 0.01;
/// Numbers of a pose, and with a gain and an offset for each channel.
const POSE: usize = 6;
const ALL: usize = POSE + 6;

/// Whether colours are fitted with the pose, so that they do not pull at it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colors {
    /// They are as they are.
    Fixed,
    /// Each channel has a gain and an offset.
    Fitted,
}

/// The camera of a photo with the pose that fits it best, found from that of `camera`; its lens stays. `length` moves what the view
/// shows as far as a radian does: about the distance to it. A photo that is wholly masked changes nothing.
///
/// # Errors
/// Not enough memory, or the device is lost.
///
/// # Panics
/// When the sizes of camera and photo differ: a bug of ours.
pub fn fit_pose(
    renderer: &Renderer,
    (camera, photo): (&Camera, &Photo),
    length: f64,
    colors: Colors,
) -> Result<Camera, GpuError> {
    assert_eq!((camera.width, camera.height), (photo.width, photo.height), "camera and photo differ in size");
    let is_large = |factor: &u32| camera.width.min(camera.height) / factor >= LEAST_SIDE;
    let mut factors: Vec<u32> = FACTORS.into_iter().filter(is_large).collect();
    if factors.is_empty() {
        factors.push(1);
    }
    let mut fit = Fit { pose: *camera, colors: [[1.0, 0.0]; 3] };
    for factor in factors {
        let level = Level { renderer, photo: Reduced::new(photo, factor), factor, length, colors };
        level.descend(&mut fit)?;
    }
    Ok(fit.pose)
}

/// What is fitted.
#[derive(Clone, Copy)]
struct Fit {
    /// The camera in the photo's full size.
    pose: Camera,
    /// Gain and offset of each channel of the render.
    colors: [[f64; 2]; 3],
}

impl Fit {
    /// After a step; lengths in units of `length`.
    fn stepped(&self, step: &[f64], length: f64) -> Self {
        let [a, b, c, d, e, f] = std::array::from_fn(|i| step[i]);
        let change = CameraChange::from_array([a * length, b * length, c * length, d, e, f, 0.0, 0.0, 0.0, 0.0]);
        let mut colors = self.colors;
        colors.as_flattened_mut().iter_mut().zip(&step[POSE..]).for_each(|(value, by)| *value += by);
        Self { pose: self.pose.changed(&change), colors }
    }
}

/// A photo of a part of the size: means of squares of pixels, in 0..1.
struct Reduced {
    width: u32,
    height: u32,
    rgb: Vec<f64>,
    /// Which pixels have no masked one in them.
    valid: Vec<bool>,
}

impl Reduced {
    fn new(photo: &Photo, factor: u32) -> Self {
        let (width, height) = (photo.width / factor, photo.height / factor);
        let (mut rgb, mut valid) = (Vec::new(), Vec::new());
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let at = |i: u32| ((y * factor + i / factor) * photo.width + x * factor + i % factor) as usize;
            let pixels = || (0..factor * factor).map(|i| &photo.rgba[4 * at(i)..][..4]);
            let count = f64::from(factor * factor);
            rgb.extend([0, 1, 2].map(|c| pixels().map(|pixel| f64::from(pixel[c])).sum::<f64>() / (255.0 * count)));
            valid.push(pixels().all(|pixel| pixel[3] >= 128));
        }
        Self { width, height, rgb, valid }
    }

    /// The camera of its size.
    fn camera(&self, full: &Camera, factor: u32) -> Camera {
        let factor = f64::from(factor);
        let (focal, principal) = (full.focal / factor, full.principal / factor);
        Camera { width: self.width, height: self.height, focal, principal, ..*full }
    }
}

/// Gauss-Newton at one size.
struct Level<'a> {
    renderer: &'a Renderer,
    photo: Reduced,
    factor: u32,
    length: f64,
    colors: Colors,
}

impl Level<'_> {
    /// The final image, or the base where there is no network, clamped.
    fn render(&self, pose: &Camera) -> Result<Vec<f64>, GpuError> {
        let frame = self.renderer.render(&self.photo.camera(pose, self.factor))?;
        let image = match frame.image()? {
            Some(image) => image,
            None => frame.base()?,
        };
        Ok(image.rgb.into_iter().map(|v| f64::from(v.clamp(0.0, 1.0))).collect())
    }

    /// What a render misses the photo by, and the square of it, at each pixel that counts.
    fn errors<'a>(&'a self, render: &'a [f64], fit: &'a Fit) -> impl Iterator<Item = (usize, [f64; 3], f64)> + 'a {
        let counted = (0..self.photo.valid.len()).filter(|&i| self.photo.valid[i]);
        counted.map(move |i| {
            let error = [0, 1, 2].map(|c| {
                let [gain, offset] = fit.colors[c];
                gain * render[3 * i + c] + offset - self.photo.rgb[3 * i + c]
            });
            (i, error, error.iter().map(|v| v * v).sum())
        })
    }

    /// The robust sum of errors.
    fn cost(&self, render: &[f64], fit: &Fit, scale: f64) -> f64 {
        let squares = self.errors(render, fit).map(|(_, _, square)| square);
        squares.map(|square| (1.0 + square / (scale * scale)).ln()).sum()
    }

    fn scale(&self, render: &[f64], fit: &Fit) -> Option<f64> {
        let square = median(self.errors(render, fit).map(|(_, _, square)| square).collect())?;
        Some((ROBUST * square.sqrt()).max(LEAST_SCALE))
    }

    /// Radians that move the image by as many pixels.
    fn radians(&self, pixels: f64, camera: &Camera) -> f64 {
        pixels * f64::from(self.factor) / camera.focal.max_element()
    }

    fn descend(&self, fit: &mut Fit) -> Result<(), GpuError> {
        let mut render = self.render(&fit.pose)?;
        let Some(scale) = self.scale(&render, fit) else { return Ok(()) };
        let mut cost = self.cost(&render, fit, scale);
        let mut damping = DAMPING;
        let mut failed = 0;
        for number in 0..STEPS {
            // Of either side in turn, so that what the differences are off by changes its sign.
            let side = if number.is_multiple_of(2) { 1.0 } else { -1.0 };
            let by = side * self.radians(DIFFERENCE, &fit.pose);
            let system = System::new(self, (&render, &self.shifted(fit, by)?), (fit, by), scale);
            let mut taken = None;
            for _ in 0..TRIES {
                let Some(step) = system.solve(damping) else { break };
                let next = fit.stepped(&step, self.length);
                let image = self.render(&next.pose)?;
                let better = self.cost(&image, &next, scale);
                if better < cost {
                    damping *= DAMPING_CHANGE[0];
                    (*fit, render, cost) = (next, image, better);
                    taken = Some(step);
                    break;
                }
                damping *= DAMPING_CHANGE[1];
            }
            failed = if taken.is_some() { 0 } else { failed + 1 };
            let least = self.radians(SMALLEST, &fit.pose);
            let is_small = taken.is_some_and(|step| step[..POSE].iter().all(|v| v.abs() < least));
            if is_small || failed == 2 {
                break;
            }
        }
        Ok(())
    }

    /// Renders with each number of the pose changed.
    fn shifted(&self, fit: &Fit, by: f64) -> Result<[Vec<f64>; POSE], GpuError> {
        let mut renders = [const { Vec::new() }; POSE];
        for (i, render) in renders.iter_mut().enumerate() {
            let mut step = [0.0; ALL];
            step[i] = by;
            *render = self.render(&fit.stepped(&step, self.length).pose)?;
        }
        Ok(renders)
    }
}

/// The normal equations of a step.
struct System {
    size: usize,
    /// Row by row.
    matrix: [[f64; ALL]; ALL],
    right: [f64; ALL],
}

impl System {
    fn new(
        level: &Level<'_>,
        (render, shifted): (&[f64], &[Vec<f64>; POSE]),
        (fit, by): (&Fit, f64),
        scale: f64,
    ) -> Self {
        let size = if level.colors == Colors::Fitted { ALL } else { POSE };
        let mut system = Self { size, matrix: [[0.0; ALL]; ALL], right: [0.0; ALL] };
        for (pixel, error, square) in level.errors(render, fit) {
            let weight = 1.0 / (1.0 + square / (scale * scale));
            for (c, error) in error.into_iter().enumerate() {
                let at = 3 * pixel + c;
                let mut row = [0.0; ALL];
                for (value, shifted) in row.iter_mut().zip(shifted) {
                    *value = fit.colors[c][0] * (shifted[at] - render[at]) / by;
                }
                (row[POSE + 2 * c], row[POSE + 2 * c + 1]) = (render[at], 1.0);
                system.add(&row[..size], weight, error);
            }
        }
        system
    }

    fn add(&mut self, row: &[f64], weight: f64, error: f64) {
        for (i, a) in row.iter().enumerate() {
            self.matrix[i].iter_mut().zip(&row[..=i]).for_each(|(sum, b)| *sum += weight * a * b);
            self.right[i] -= weight * a * error;
        }
    }

    /// The step; none where nothing depends on the pose.
    fn solve(&self, damping: f64) -> Option<Vec<f64>> {
        let mut matrix = Symmetric::zero(self.size);
        for (i, row) in self.matrix[..self.size].iter().enumerate() {
            row[..=i].iter().enumerate().for_each(|(j, value)| matrix.add(i, j, *value));
            matrix.add(i, i, damping * row[i]);
        }
        let mut step = matrix.solve(self.right[..self.size].to_vec())?;
        step.resize(ALL, 0.0);
        Some(step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reduced_photo_has_means_and_no_pixel_that_is_masked_in_part() {
        // Seven by five: the last column and row are left out.
        let pixel = |i: u32| [(5 * i) as u8, 10, 20, if i == 9 { 0 } else { 255 }];
        let photo = Photo { width: 7, height: 5, rgba: (0..35).flat_map(pixel).collect() };
        let reduced = Reduced::new(&photo, 2);
        assert_eq!((reduced.width, reduced.height, reduced.rgb.len()), (3, 2, 18));
        assert_eq!(reduced.valid, [true, false, true, true, true, true]);
        // Pixels 2, 3, 9 and 10 are the second.
        assert!((reduced.rgb[3] - 5.0 * 6.0 / 255.0).abs() < 1e-12, "{:?}", reduced.rgb);
        assert!((reduced.rgb[4] - 10.0 / 255.0).abs() < 1e-12);
    }

    #[test]
    fn equations_are_solved_as_least_squares() {
        let mut system = System { size: POSE, matrix: [[0.0; ALL]; ALL], right: [0.0; ALL] };
        let truth = [1.0, -2.0, 0.5, 3.0, 0.0, -1.0];
        for k in 0..40 {
            let row: [f64; POSE] = std::array::from_fn(|i| (f64::from(k) * (i as f64 + 1.0)).sin());
            let error = -row.iter().zip(&truth).map(|(a, b)| a * b).sum::<f64>();
            system.add(&row, 1.0 + f64::from(k), error);
        }
        let step = system.solve(0.0).unwrap();
        assert_eq!(step.len(), ALL);
        assert!(step.iter().zip(&truth).all(|(a, b)| (a - b).abs() < 1e-9), "{step:?}");
        assert!(System { size: POSE, matrix: [[0.0; ALL]; ALL], right: [0.0; ALL] }.solve(1e-3).is_none());
    }
}
