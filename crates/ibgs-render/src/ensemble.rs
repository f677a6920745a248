//! The mean of the images of an ensemble.
//!
//! Trainings that differ in nothing but their random numbers err in different places: of the squared error of an image 8 to
//! 25 % is chance, and a mean of N images keeps an Nth of it. An ensemble's base image is the mean of those of its members, each
//! trained on its own. A departure from the published method (method.md section 6).

use crate::gpu::{Buffer, Pass};
use ibgs_shaders::bindings::AverageBindings;
use ibgs_shaders::types::AverageParams;

/// Takes one more image into a mean.
#[derive(Clone, Copy, Debug)]
pub struct Average {
    params: AverageParams,
}

impl Average {
    /// For images of `values` numbers, of which the mean has `images` already.
    pub fn new(values: usize, images: usize) -> Self {
        let other = 1.0 / (images as f32 + 1.0);
        Self { params: AverageParams { values: values as u32, own: 1.0 - other, other } }
    }

    /// Records the mean of `image`, itself a mean, and of a further member's image into `mean`; all are `[H, W, 3]`.
    pub fn record(&self, pass: &mut Pass<'_>, image: &Buffer<f32>, member: &Buffer<f32>, mean: &Buffer<f32>) {
        pass.linear(&AverageBindings { image, member, mean }, &self.params, self.params.values as usize);
    }

    /// Records the gradient by `image` into `v_image` from that by the mean; the member's image is a constant.
    pub fn record_backward(&self, pass: &mut Pass<'_>, v_mean: &Buffer<f32>, v_image: &Buffer<f32>) {
        let params = AverageParams { other: 0.0, ..self.params };
        let bindings = AverageBindings { image: v_mean, member: v_mean, mean: v_image };
        pass.linear(&bindings, &params, params.values as usize);
    }
}
