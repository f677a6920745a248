//! The images of an ensemble.
//!
//! Trainings that differ in nothing but their random numbers err in different places: of the squared error of an image 8 to
//! 19 % is chance, and a mean of N images keeps an Nth of it. An ensemble's base image is the mean of those of its members, each
//! trained on its own; the residual of the first is laid over it as it is: final image + mean - base image of the first. A
//! departure from the published method (method.md section 6).

use crate::gpu::{Buffer, Pass};
use ibgs_shaders::bindings::WeightedSumBindings;
use ibgs_shaders::types::WeightedSumParams;

/// Records the weighted sum of two images into `sum`; all are `values` numbers, `[H, W, 3]`.
pub fn record_weighted_sum(
    pass: &mut Pass<'_>,
    values: usize,
    [(first, a), (second, b)]: [(f32, &Buffer<f32>); 2],
    sum: &Buffer<f32>,
) {
    let params = WeightedSumParams { values: values as u32, first, second };
    pass.linear(&WeightedSumBindings { a, b, sum }, &params, values);
}
