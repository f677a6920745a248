//! Images and warped colours in a photo's exposure.

use super::unary;
use crate::tensor::{bind, bind_rows, empty, empty_like};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::exposure::Exposures;
use ibgs_core::gpu::{GpuError, Pass};
use ibgs_core::raster::Forward;
use ibgs_core::sources::Warped;

/// The tracked image of a pass in the target's exposure, on the autodiff graph. The gradient by the exposure itself is
/// [`Exposures::v_target`]; none flows through the transmittance.
///
/// # Errors
/// Not enough memory.
///
/// # Panics
/// When the image is not on the autodiff graph: a bug of ours.
pub fn exposed(exposures: &Exposures, image: &Tensor<3>, forward: &Forward) -> Result<Tensor<3>, GpuError> {
    let (exposures, forward) = (exposures.clone(), forward.clone());
    unary(image.clone(), |image| {
        let out = empty(exposures.gpu(), "exposed image", image.meta.shape())?;
        let mut pass = Pass::new(exposures.gpu(), "exposure");
        exposures.record(&mut pass, &forward, &bind(&out));
        pass.submit();
        let exposures = exposures.clone();
        let rule = move |v_exposed: &CubeTensor| {
            let v_image = empty_like(v_exposed, v_exposed.meta.shape());
            exposures.backward(&forward, &bind(v_exposed), &bind(&v_image));
            Some(v_image)
        };
        Ok((out, rule))
    })
}

/// Tracked warped colours `[V, P, 4]` in the target's exposure, on the autodiff graph; the exposures are constants.
///
/// # Errors
/// Not enough memory.
///
/// # Panics
/// When the colours are not on the autodiff graph: a bug of ours.
pub fn exposed_warped(exposures: &Exposures, colors: Tensor<3>, warped: &Warped) -> Result<Tensor<3>, GpuError> {
    let (exposures, warped) = (exposures.clone(), warped.clone());
    unary(colors, |colors| {
        let out = empty(exposures.gpu(), "exposed warped colours", colors.meta.shape())?;
        let mut pass = Pass::new(exposures.gpu(), "exposure");
        exposures.record_warped(&mut pass, &warped, &bind_rows(&out));
        pass.submit();
        let exposures = exposures.clone();
        let rule = move |v_exposed: &CubeTensor| {
            let v_colors = empty_like(v_exposed, v_exposed.meta.shape());
            exposures.warped_backward(&warped, &bind_rows(v_exposed), &bind_rows(&v_colors));
            Some(v_colors)
        };
        Ok((out, rule))
    })
}
