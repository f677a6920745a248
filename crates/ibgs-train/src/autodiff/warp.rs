//! Warping.

use super::unary;
use crate::tensor::{bind_rows, empty};
use burn::tensor::Tensor;
use ibgs_core::gpu::GpuError;
use ibgs_core::raster::Forward;
use ibgs_core::sources::{SourceView, Warped, Warper};

/// Warped colours `[V, P, 4]` on the autodiff graph of the image that `forward` made, and the pass. Gradients flow through the
/// bilinear reads, the weights, the median depth and the cosine: into the surface's own gradient buffers, which the rasterizer
/// reads. The image, the parent, gets none from here.
///
/// # Errors
/// Not enough memory.
///
/// # Panics
/// Without a surface or a source, or when the image is not tracked: bugs of ours.
pub fn warped(
    warper: &Warper,
    image: &Tensor<3>,
    forward: &Forward,
    sources: &[SourceView],
) -> Result<(Tensor<3>, Warped), GpuError> {
    let gpu = warper.gpu().clone();
    let pixels = forward.frame.size.map(|n| n as usize).iter().product();
    let colors = empty(&gpu, "warped colours", &[warper.options.visible as usize, pixels, 4])?;
    let warped = warper.warp(forward, sources, bind_rows(&colors))?;
    let pass = warped.clone();
    let colors = unary(image.clone(), |_| {
        let rule = move |v_colors: &_| {
            pass.backward(&gpu, &bind_rows(v_colors));
            None
        };
        Ok::<_, GpuError>((colors, rule))
    })?;
    Ok((colors, warped))
}
