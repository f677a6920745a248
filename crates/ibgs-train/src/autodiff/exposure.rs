//! Images and warped colours in a photo's exposure.

use crate::tensor::{bind, contiguous, empty, empty_like};
use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::tensor::Tensor;
use burn_wgpu::CubeBackend;
use ibgs_core::exposure::Exposures;
use ibgs_core::gpu::{GpuError, Pass};
use ibgs_core::raster::Forward;
use ibgs_core::sources::Warped;

#[derive(Debug)]
struct ExposeBackward;

#[derive(Clone, Debug)]
struct Saved {
    exposures: Exposures,
    forward: Forward,
}

impl Backward<CubeBackend, 1> for ExposeBackward {
    type State = Saved;

    fn backward(self, ops: Ops<Saved, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_exposed = contiguous(grads.consume::<CubeBackend>(&ops.node));
        let [Some(parent)] = ops.parents else { return };
        let Saved { exposures, forward } = ops.state;
        let v_image = empty_like(&v_exposed, v_exposed.meta.shape());
        exposures.backward(&forward, &bind(&v_exposed), &bind(&v_image));
        grads.register::<CubeBackend>(parent.id, v_image);
    }
}

#[derive(Debug)]
struct WarpedBackward;

#[derive(Clone, Debug)]
struct SavedWarped {
    exposures: Exposures,
    warped: Warped,
}

impl Backward<CubeBackend, 1> for WarpedBackward {
    type State = SavedWarped;

    fn backward(self, ops: Ops<SavedWarped, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_exposed = contiguous(grads.consume::<CubeBackend>(&ops.node));
        let [Some(parent)] = ops.parents else { return };
        let SavedWarped { exposures, warped } = ops.state;
        let v_colors = empty_like(&v_exposed, v_exposed.meta.shape());
        exposures.warped_backward(&warped, &bind(&v_exposed), &bind(&v_colors));
        grads.register::<CubeBackend>(parent.id, v_colors);
    }
}

/// The tracked image of a pass in the target's exposure, on the autodiff graph. The gradient by the exposure itself is
/// [`Exposures::v_target`]; none flows through the transmittance.
///
/// # Errors
/// Not enough memory.
///
/// # Panics
/// When the image is not on the autodiff graph: a bug of ours.
pub fn exposed(exposures: &Exposures, image: &Tensor<3>, forward: &Forward) -> Result<Tensor<3>, GpuError> {
    type Ad = Autodiff<CubeBackend>;
    let image = image.clone().try_into_primitive::<Ad>().expect("the image is on the autodiff graph");
    let node = image.node();
    let gpu = exposures.gpu();
    let out = empty(gpu, "exposed image", image.into_primitive().meta.shape())?;
    let mut pass = Pass::new(gpu, "exposure");
    exposures.record(&mut pass, forward, &bind(&out));
    pass.submit();
    let output = match ExposeBackward.prepare::<NoCheckpointing>([node]).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(Saved { exposures: exposures.clone(), forward: forward.clone() }, out),
        OpsKind::UnTracked(prep) => prep.finish(out),
    };
    Ok(Tensor::from_primitive::<Ad>(output))
}

/// Tracked warped colours `[V, P, 4]` in the target's exposure, on the autodiff graph; the exposures are constants.
///
/// # Errors
/// Not enough memory.
///
/// # Panics
/// When the colours are not on the autodiff graph: a bug of ours.
pub fn exposed_warped(exposures: &Exposures, colors: Tensor<3>, warped: &Warped) -> Result<Tensor<3>, GpuError> {
    type Ad = Autodiff<CubeBackend>;
    let colors = colors.try_into_primitive::<Ad>().expect("the colours are on the autodiff graph");
    let node = colors.node();
    let gpu = exposures.gpu();
    let out = empty(gpu, "exposed warped colours", colors.into_primitive().meta.shape())?;
    let mut pass = Pass::new(gpu, "exposure");
    exposures.record_warped(&mut pass, warped, &bind(&out));
    pass.submit();
    let output = match WarpedBackward.prepare::<NoCheckpointing>([node]).compute_bound().stateful() {
        OpsKind::Tracked(prep) => {
            prep.finish(SavedWarped { exposures: exposures.clone(), warped: warped.clone() }, out)
        }
        OpsKind::UnTracked(prep) => prep.finish(out),
    };
    Ok(Tensor::from_primitive::<Ad>(output))
}
