//! The mean of the images of an ensemble.

use super::unary;
use crate::tensor::{bind, empty, empty_like};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::ensemble::Average;
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Pass};
use std::sync::Arc;

/// The mean of a tracked image `[H, W, 3]` and of those of further members, which are constants, on the autodiff graph.
///
/// # Errors
/// Not enough memory.
///
/// # Panics
/// When the image is not on the autodiff graph: a bug of ours.
pub fn averaged(gpu: &Arc<Gpu>, image: Tensor<3>, members: &[Buffer<f32>]) -> Result<Tensor<3>, GpuError> {
    members.iter().zip(1..).try_fold(image, |mean, (member, images)| with_member(gpu, mean, (member, images)))
}

/// The mean of the images of so many members, with that of one more.
fn with_member(
    gpu: &Arc<Gpu>,
    image: Tensor<3>,
    (member, images): (&Buffer<f32>, usize),
) -> Result<Tensor<3>, GpuError> {
    unary(image, |image| {
        let average = Average::new(image.meta.shape().iter().product(), images);
        let out = empty(gpu, "mean of the base images", image.meta.shape())?;
        let mut pass = Pass::new(gpu, "ensemble");
        average.record(&mut pass, &bind(&image), member, &bind(&out));
        pass.keep(member.clone());
        pass.submit();
        let gpu = gpu.clone();
        let rule = move |v_mean: &CubeTensor| {
            let v_image = empty_like(v_mean, v_mean.meta.shape());
            let mut pass = Pass::new(&gpu, "ensemble backward");
            average.record_backward(&mut pass, &bind(v_mean), &bind(&v_image));
            pass.submit();
            Some(v_image)
        };
        Ok((out, rule))
    })
}
