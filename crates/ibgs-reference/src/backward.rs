//! Twin of the blending kernel's backward pass (method.md section 2): true derivatives, thresholds held fixed.

use ibgs_data::camera::Camera;
use rayon::prelude::*;

use super::project::project_backward_as;
use super::raster::{Contribution, contributions, tile_pixels};
use super::{Forward, Grads, MAX_ALPHA, Params, Projected, SplatGrads};

/// Sums of one Gaussian over the pixels of one tile, later over the tiles.
#[derive(Clone, Copy, Default)]
pub(super) struct Sum {
    xy: [f64; 2],
    xy_abs: [f64; 2],
    conic: [f64; 3],
    opacity: f64,
    color: [f64; 3],
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn add<const N: usize>(to: &mut [f64; N], v: [f64; N]) {
    for (t, x) in to.iter_mut().zip(v) {
        *t += x;
    }
}

impl Sum {
    /// Adds one contribution given the gradient by its alpha and by its colour.
    pub(super) fn add_part(&mut self, splat: &Projected, part: &Contribution, v_alpha: f64, v_color: [f64; 3]) {
        add(&mut self.color, v_color);
        // Where alpha was clamped it is a constant.
        if splat.opacity * part.falloff >= MAX_ALPHA {
            return;
        }
        self.opacity += v_alpha * part.falloff;
        let v_power = v_alpha * part.alpha;
        let [dx, dy] = part.offset;
        let [a, b, c] = splat.conic;
        add(&mut self.conic, [-0.5 * dx * dx * v_power, -dx * dy * v_power, -0.5 * dy * dy * v_power]);
        let v_xy = [-(a * dx + b * dy) * v_power, -(b * dx + c * dy) * v_power];
        add(&mut self.xy, v_xy);
        add(&mut self.xy_abs, v_xy.map(f64::abs));
    }

    pub(super) fn add_sum(&mut self, other: &Sum) {
        add(&mut self.xy, other.xy);
        add(&mut self.xy_abs, other.xy_abs);
        add(&mut self.conic, other.conic);
        self.opacity += other.opacity;
        add(&mut self.color, other.color);
    }
}

/// Walks one pixel back to front. `behind` is the gradient's product with all that lies behind the contribution.
fn pixel_backward(projected: &[Projected], parts: &[Contribution], behind: f64, v_pixel: [f64; 3], sums: &mut [Sum]) {
    let mut behind = behind;
    for part in parts.iter().rev() {
        let splat = &projected[part.gaussian];
        let weight = part.alpha * part.transmittance;
        let v_color = dot(v_pixel, splat.color);
        // Behind it everything carries the factor 1 - alpha.
        let v_alpha = part.transmittance * v_color - behind / (1.0 - part.alpha);
        sums[part.entry].add_part(splat, part, v_alpha, v_pixel.map(|v| v * weight));
        behind += weight * v_color;
    }
}

/// Gradients by what the blending reads, given the gradient `v_image` by its image. The sums run over the pixels of a
/// tile, then over the tiles in order, so the result does not depend on the number of threads.
pub fn rasterize_backward(
    camera: &Camera,
    background: [f64; 3],
    forward: &Forward,
    v_image: &[[f64; 3]],
) -> SplatGrads {
    assert_eq!(v_image.len(), forward.image.len(), "one gradient per pixel");
    let projected = &forward.projected;
    let tile_sums = |(tile, list): (usize, &Vec<u32>)| {
        let mut sums = vec![Sum::default(); list.len()];
        for (x, y) in tile_pixels(camera, tile) {
            let v_pixel = v_image[(y * camera.width + x) as usize];
            let (parts, final_t) = contributions(projected, list, x, y);
            let behind = final_t * dot(v_pixel, background);
            pixel_backward(projected, &parts, behind, v_pixel, &mut sums);
        }
        sums
    };
    let tiles: Vec<Vec<Sum>> = forward.order.par_iter().enumerate().map(tile_sums).collect();

    let mut total = vec![Sum::default(); projected.len()];
    for (list, sums) in forward.order.iter().zip(&tiles) {
        for (gaussian, sum) in list.iter().zip(sums) {
            total[*gaussian as usize].add_sum(sum);
        }
    }
    splat_grads(&total)
}

/// The sums of all Gaussians as tensors.
pub(super) fn splat_grads(total: &[Sum]) -> SplatGrads {
    SplatGrads {
        xy: total.iter().map(|s| s.xy).collect(),
        xy_abs: total.iter().map(|s| s.xy_abs).collect(),
        conic: total.iter().map(|s| s.conic).collect(),
        opacity: total.iter().map(|s| s.opacity).collect(),
        color: total.iter().map(|s| s.color).collect(),
    }
}

/// Gradients by the raw parameters, given the gradient `v_image` by the rendered image.
pub fn backward(p: &Params, camera: &Camera, background: [f64; 3], forward: &Forward, v_image: &[[f64; 3]]) -> Grads {
    let v = rasterize_backward(camera, background, forward, v_image);
    project_backward_as(p, camera, forward.active_sh_degree, &forward.projected, &v, forward.model)
}
