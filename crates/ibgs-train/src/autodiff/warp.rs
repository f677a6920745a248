//! Warping.

use crate::tensor::{bind, contiguous, empty};
use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::tensor::Tensor;
use burn_wgpu::CubeBackend;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::raster::Forward;
use ibgs_core::sources::{SourceView, Warped, Warper};
use std::sync::Arc;

#[derive(Debug)]
struct WarpBackward;

#[derive(Clone, Debug)]
struct Saved {
    gpu: Arc<Gpu>,
    warped: Warped,
}

impl Backward<CubeBackend, 1> for WarpBackward {
    type State = Saved;

    /// The gradient goes into the surface's own gradient buffers, which the rasterizer reads: the image, the parent, gets
    /// none from here.
    fn backward(self, ops: Ops<Saved, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_colors = contiguous(grads.consume::<CubeBackend>(&ops.node));
        ops.state.warped.backward(&ops.state.gpu, &bind(&v_colors));
    }
}

/// Warped colours `[V, P, 4]` on the autodiff graph of the image that `forward` made, and the pass. Gradients flow through the
/// bilinear reads, the weights, the median depth and the cosine.
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
    type Ad = Autodiff<CubeBackend>;
    let image = image.clone().try_into_primitive::<Ad>().expect("the image is on the autodiff graph");
    let pixels = forward.frame.size.map(|n| n as usize).iter().product();
    let gpu = warper.gpu();
    let colors = empty(gpu, "warped colours", &[warper.options.visible as usize, pixels, 4])?;
    let warped = warper.warp(forward, sources, bind(&colors))?;
    let output = match WarpBackward.prepare::<NoCheckpointing>([image.node()]).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(Saved { gpu: gpu.clone(), warped: warped.clone() }, colors),
        OpsKind::UnTracked(prep) => prep.finish(colors),
    };
    Ok((Tensor::from_primitive::<Ad>(output), warped))
}
