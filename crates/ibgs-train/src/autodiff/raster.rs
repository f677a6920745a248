//! The rasterizer.

use super::node::{node, on_graph};
use crate::parameters::Parameters;
use crate::tensor::{bind, empty, empty_like};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::gpu::GpuError;
use ibgs_core::raster::{CameraGradients, Forward, Keep, RasterView, Rasterizer, ScreenStatistics};
use ibgs_core::scene::{PerGaussian, Splats};

/// The Gaussians as leaves of one iteration's graph.
pub struct Leaves {
    /// The raw parameters, each of one dimension.
    parameters: PerGaussian<Tensor<1>>,
    splats: Splats,
}

/// Gradients of one backward pass by the raw parameters, each of one dimension, in rows of [`PerGaussian::gradient_rows`]; those of the
/// planes are none without a surface.
pub type SplatGradients = PerGaussian<Option<Tensor<1>>>;

fn leaf(tensor: &CubeTensor) -> Tensor<1> {
    crate::tensor::from_primitive(tensor.clone()).autodiff().require_grad()
}

impl Leaves {
    /// Tracks the Gaussians' parameters for one iteration.
    pub fn new(parameters: &Parameters) -> Self {
        Self { parameters: parameters.tensors.as_ref().map(leaf), splats: parameters.splats().clone() }
    }

    /// Takes the gradients out of a finished backward pass; none when the image did not reach the loss.
    pub fn gradients(&self, grads: &mut burn::tensor::Gradients) -> Option<SplatGradients> {
        let gradients = self.parameters.as_ref().map(|leaf| leaf.grad_remove(grads));
        gradients.means.is_some().then_some(gradients)
    }
}

/// Rasterizes tracked Gaussians: image `[H, W, 3]` on the autodiff graph, and the pass's scratch memory (radii and intersection
/// count), which stays valid as long as it is held. Everything that is made of the pass adds its gradient by the cameras to
/// `cameras`; its own gradient adds the view to `statistics`.
///
/// # Errors
/// Not enough memory.
pub fn rasterized(
    raster: &Rasterizer,
    leaves: &Leaves,
    view: &RasterView,
    cameras: Option<&CameraGradients>,
    statistics: Option<ScreenStatistics>,
) -> Result<(Tensor<3>, Forward), GpuError> {
    let (gpu, splats) = (raster.gpu().clone(), leaves.splats.clone());
    let image = empty(&gpu, "image", &[view.camera.height as usize, view.camera.width as usize, 3])?;
    let mut forward = raster.forward(&splats, view, Keep::Gradients, bind(&image))?;
    forward.cameras = cameras.cloned();
    forward.statistics = statistics;
    let pass = forward.clone();
    let parents = leaves.parameters.clone().map(on_graph).into_array();
    let image = node(parents, |_| {
        let rule = move |v_image: &CubeTensor, _| {
            let is_there = PerGaussian::with_gradients(pass.surface().is_some());
            let sizes = PerGaussian::gradient_rows().map(|row| row * splats.count);
            let gradients = sizes.zip(is_there).map(|(size, is_there)| is_there.then(|| empty_like(v_image, &[size])));
            let bound = gradients.as_ref().map(|gradient| gradient.as_ref().map(bind));
            pass.backward(&gpu, &splats, &bind(v_image), &bound);
            gradients.into_array()
        };
        Ok::<_, GpuError>((image, rule))
    })?;
    Ok((image, forward))
}
