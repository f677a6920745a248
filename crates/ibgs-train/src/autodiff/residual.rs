//! The residual network and the composition of the final image.

use super::node::{node, on_graph};
use crate::tensor::{bind, bind_rows, empty, empty_like};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::gpu::GpuError;
use ibgs_core::raster::Keep;
use ibgs_core::residual::{Residual, ResidualGradients, ResidualInputs, ResidualTask};

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
    let gpu = stage.gpu().clone();
    node([on_graph(base), on_graph(warped), on_graph(weights)], |tensors| {
        let shapes = tensors.each_ref().map(|tensor| tensor.meta.shape().to_vec());
        let image = empty(&gpu, "final image", &shapes[0])?;
        let visible = shapes[1][0] as u32;
        let [base, warped, weights] = &tensors;
        let inputs = ResidualInputs { base: bind(base), warped: bind_rows(warped), visible, weights: bind(weights) };
        let pass = stage.forward(task, inputs, Keep::Gradients, bind(&image))?;
        let gpu = gpu.clone();
        let rule = move |v_image: &CubeTensor, [base_learns, warped_learns, _]: [bool; 3]| {
            let inputs_learn = base_learns || warped_learns;
            let [v_base, v_warped, v_weights] = shapes.each_ref().map(|shape| empty_like(v_image, shape));
            let (base, warped, weights) = (bind(&v_base), bind_rows(&v_warped), bind(&v_weights));
            let gradients =
                ResidualGradients { base: &base, warped: inputs_learn.then_some(&warped), weights: &weights };
            pass.backward(&gpu, &bind(v_image), &gradients);
            [inputs_learn.then_some(v_base), inputs_learn.then_some(v_warped), Some(v_weights)]
        };
        Ok((image, rule))
    })
}
