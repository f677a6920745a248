//! The rasterizer.

use super::node::{node, on_graph};
use crate::parameters::Parameters;
use crate::tensor::{bind, bind_rows, empty, empty_like};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::raster::{CameraGradients, Forward, Keep, RasterGradients, RasterView, Rasterizer};
use ibgs_core::scene::{PerGaussian, Splats};

/// What the image is made of: the parameters and the screen positions.
const PARENTS: usize = PerGaussian::KINDS + 1;

/// The Gaussians as leaves of one iteration's graph, and a tensor whose gradient is the screen-space one.
pub struct Leaves {
    /// The raw parameters, each of one dimension.
    parameters: PerGaussian<Tensor<1>>,
    /// Without values: its gradient, `[N, 4]`, holds (x, y, |x|, |y|) by the projected mean in pixels, summed over pixels.
    screen: Tensor<2>,
    splats: Splats,
}

/// Gradients of one backward pass.
pub struct SplatGradients {
    /// By the raw parameters, each of one dimension, in rows of [`PerGaussian::gradient_rows`]; those of the planes are none without a
    /// surface.
    pub parameters: PerGaussian<Option<Tensor<1>>>,
    /// Signed and absolute screen-space gradients, `[N, 4]`.
    pub screen: Tensor<2>,
}

fn leaf<const D: usize>(tensor: &CubeTensor) -> Tensor<D> {
    crate::tensor::from_primitive::<D>(tensor.clone()).autodiff().require_grad()
}

/// In the order of the image's parents.
fn parents<T>(parameters: PerGaussian<T>, screen: T) -> [T; PARENTS] {
    let mut all = parameters.into_array().into_iter().chain([screen]);
    std::array::from_fn(|_| all.next().expect("as many parents"))
}

impl Leaves {
    /// Tracks the Gaussians' parameters for one iteration.
    ///
    /// # Errors
    /// When the device cannot bind that many screen-space gradients at once.
    pub fn new(gpu: &Gpu, parameters: &Parameters) -> Result<Self, GpuError> {
        // It only carries a gradient, whose shape burn does not compare.
        gpu.check_size("screen positions", 16 * parameters.splats().count as u64)?;
        let screen = empty(gpu, "screen positions", &[1, 4])?;
        Ok(Self {
            parameters: parameters.tensors.as_ref().map(leaf),
            screen: leaf(&screen),
            splats: parameters.splats().clone(),
        })
    }

    /// Takes the gradients out of a finished backward pass; none when the image did not reach the loss.
    pub fn gradients(&self, grads: &mut burn::tensor::Gradients) -> Option<SplatGradients> {
        let screen = self.screen.grad_remove(grads)?;
        Some(SplatGradients { parameters: self.parameters.as_ref().map(|leaf| leaf.grad_remove(grads)), screen })
    }
}

/// Rasterizes tracked Gaussians: image `[H, W, 3]` on the autodiff graph, and the pass's scratch memory (radii and intersection
/// count), which stays valid as long as it is held. Everything that is made of the pass adds its gradient by the cameras to
/// `cameras`.
///
/// # Errors
/// Not enough memory.
pub fn rasterized(
    raster: &Rasterizer,
    leaves: &Leaves,
    view: &RasterView,
    cameras: Option<&CameraGradients>,
) -> Result<(Tensor<3>, Forward), GpuError> {
    let (gpu, splats) = (raster.gpu().clone(), leaves.splats.clone());
    let image = empty(&gpu, "image", &[view.camera.height as usize, view.camera.width as usize, 3])?;
    let mut forward = raster.forward(&splats, view, Keep::Gradients, bind(&image))?;
    forward.cameras = cameras.cloned();
    let pass = forward.clone();
    let parents_of_image = parents(leaves.parameters.clone().map(on_graph), on_graph(leaves.screen.clone()));
    let image = node(parents_of_image, |_| {
        let rule = move |v_image: &CubeTensor, _| {
            let is_there = PerGaussian::with_gradients(pass.surface().is_some());
            let sizes = PerGaussian::gradient_rows().map(|row| row * splats.count);
            let gradients = sizes.zip(is_there).map(|(size, is_there)| is_there.then(|| empty_like(v_image, &[size])));
            let screen = empty_like(v_image, &[splats.count, 4]);
            let v = RasterGradients {
                parameters: gradients.as_ref().map(|gradient| gradient.as_ref().map(bind)),
                screen: bind_rows(&screen),
            };
            pass.backward(&gpu, &splats, &bind(v_image), &v);
            parents(gradients, Some(screen))
        };
        Ok::<_, GpuError>((image, rule))
    })?;
    Ok((image, forward))
}
