//! The images of an ensemble.
//!
//! Trainings that differ in nothing but their random numbers err in different places: of the squared error of an image 8 to
//! 19 % is chance, and a mean of N images keeps an Nth of it. An ensemble's base image is the mean of those of its members, each
//! trained on its own; over it lies the mean of the residuals of those members that have a network: final minus base image of
//! each. A departure from the published method (method.md section 6).

use crate::gpu::{Buffer, Pass};
use ibgs_shaders::bindings::WeightedSumBindings;
use ibgs_shaders::types::WeightedSumParams;

/// Weights in the base image of each of the `alike` members with a network, and of each of the `others` without: both kinds have
/// half of it, for a residual fits its own base best. Where none has a network all are alike.
pub fn weights(alike: usize, others: usize) -> [f32; 2] {
    let half = if others == 0 { 1.0 } else { 0.5 };
    [half / alike as f32, half / others.max(1) as f32]
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_a_mean() {
        for (alike, others) in [(1, 0), (1, 1), (1, 3), (2, 4), (3, 0)] {
            let [first, other] = weights(alike, others);
            let all = first * alike as f32 + other * others as f32;
            assert!((all - 1.0).abs() < 1e-6, "{alike} and {others}: {all}");
        }
        assert_eq!([weights(1, 1), weights(2, 4)], [[0.5, 0.5], [0.25, 0.125]]);
    }
}
