//! The residual network and the composition of the final image.

use crate::tensor::{bind, contiguous, empty, empty_like};
use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use burn_wgpu::CubeBackend;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::raster::Keep;
use ibgs_core::residual::{Residual, ResidualGradients, ResidualInputs, ResidualPass, ResidualTask};
use std::sync::Arc;

#[derive(Debug)]
struct ResidualBackward;

#[derive(Clone, Debug)]
struct Saved {
    gpu: Arc<Gpu>,
    pass: ResidualPass,
    /// Shapes of base colour, warped colours and weights.
    shapes: [Vec<usize>; 3],
}

impl Backward<CubeBackend, 3> for ResidualBackward {
    type State = Saved;

    fn backward(self, ops: Ops<Saved, 3>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_image = contiguous(grads.consume::<CubeBackend>(&ops.node));
        let inputs_learn = ops.parents[..2].iter().any(Option::is_some);
        let [v_base, v_warped, v_weights] = ops.state.shapes.each_ref().map(|shape| empty_like(&v_image, shape));
        let [base, warped, weights] = [&v_base, &v_warped, &v_weights].map(bind);
        let gradients = ResidualGradients { base: &base, warped: inputs_learn.then_some(&warped), weights: &weights };
        ops.state.pass.backward(&ops.state.gpu, &bind(&v_image), &gradients);
        let results = [inputs_learn.then_some(v_base), inputs_learn.then_some(v_warped), Some(v_weights)];
        for (parent, gradient) in ops.parents.into_iter().zip(results) {
            if let Some((node, gradient)) = parent.zip(gradient) {
                grads.register::<CubeBackend>(node.id, gradient);
            }
        }
    }
}

/// Final image `[H, W, 3]` from base colour `[H, W, 3]`, warped colours `[V, P, 4]` and weights on the autodiff graph. Gradients
/// flow into the weights, and into base and warped colours where these are tracked themselves.
///
/// # Errors
/// Not enough memory.
///
/// # Panics
/// For an image that does not fit ([`Residual::fits`]), or tensors that are not on the autodiff graph: bugs of ours.
pub fn residual(
    stage: &Residual,
    task: &ResidualTask,
    base: Tensor<3>,
    warped: Tensor<3>,
    weights: Tensor<1>,
) -> Result<Tensor<3>, GpuError> {
    type Ad = Autodiff<CubeBackend>;
    let on_graph = "the tensors are on the autodiff graph";
    let base = base.try_into_primitive::<Ad>().expect(on_graph);
    let warped = warped.try_into_primitive::<Ad>().expect(on_graph);
    let weights = weights.try_into_primitive::<Ad>().expect(on_graph);
    let nodes = [base.node(), warped.node(), weights.node()];
    let tensors = [base.into_primitive(), warped.into_primitive(), weights.into_primitive()].map(contiguous);
    let shapes = tensors.each_ref().map(|tensor: &CubeTensor| tensor.meta.shape().to_vec());
    let image = empty(stage.gpu(), "final image", &shapes[0])?;
    let slots = shapes[1][0] as u32;
    let [base, warped, weights] = tensors.each_ref().map(bind);
    let inputs = ResidualInputs { base, warped, slots, weights };
    let pass = stage.forward(task, inputs, Keep::Gradients, bind(&image))?;
    let output = match ResidualBackward.prepare::<NoCheckpointing>(nodes).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(Saved { gpu: stage.gpu().clone(), pass, shapes }, image),
        OpsKind::UnTracked(prep) => prep.finish(image),
    };
    Ok(Tensor::from_primitive::<Ad>(output))
}
