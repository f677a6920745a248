//! The rasterizer.

use super::node::{node, on_graph};
use crate::parameters::Parameters;
use crate::tensor::{bind, bind_rows, empty, empty_like};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::raster::{Forward, Keep, RasterGradients, RasterView, Rasterizer};
use ibgs_core::scene::Splats;

/// The Gaussians as leaves of one iteration's graph, and a tensor whose gradient is the screen-space one.
pub struct Leaves {
    /// `[N, 3]`
    pub means: Tensor<2>,
    /// `[N, 4]`
    pub rotations: Tensor<2>,
    /// `[N, 3]`
    pub log_scales: Tensor<2>,
    /// `[N]`
    pub opacity_logits: Tensor<1>,
    /// `[N, coefficients, 3]`
    pub sh: Tensor<3>,
    /// `[N, 3]`
    pub normals: Tensor<2>,
    /// `[N]`
    pub offsets: Tensor<1>,
    /// `[N, 4]`: its gradient holds (x, y, |x|, |y|) by the projected mean in pixels, summed over pixels.
    pub screen: Tensor<2>,
    splats: Splats,
}

/// Gradients of one backward pass, in the shapes of [`Leaves`].
pub struct SplatGradients {
    /// By the means.
    pub means: Tensor<2>,
    /// By the raw quaternions.
    pub rotations: Tensor<2>,
    /// By the logarithms of the scales.
    pub log_scales: Tensor<2>,
    /// By the opacity logits.
    pub opacity_logits: Tensor<1>,
    /// By the spherical-harmonics coefficients.
    pub sh: Tensor<3>,
    /// Signed and absolute screen-space gradients.
    pub screen: Tensor<2>,
    /// By the raw normals and offsets of the planes; none without a surface.
    pub planes: Option<(Tensor<2>, Tensor<1>)>,
}

fn leaf<const D: usize>(tensor: &CubeTensor) -> Tensor<D> {
    crate::tensor::from_primitive::<D>(tensor.clone()).autodiff().require_grad()
}

impl Leaves {
    /// Tracks the Gaussians' parameters for one iteration.
    ///
    /// # Errors
    /// When the device cannot bind that many screen-space gradients at once.
    pub fn new(gpu: &Gpu, parameters: &Parameters) -> Result<Self, GpuError> {
        let t = &parameters.tensors;
        // Never read or written by the forward pass: it only carries a gradient.
        let screen = empty(gpu, "screen positions", &[parameters.splats().count, 4])?;
        Ok(Self {
            means: leaf(&t.means),
            rotations: leaf(&t.rotations),
            log_scales: leaf(&t.log_scales),
            opacity_logits: leaf(&t.opacity_logits),
            sh: leaf(&t.sh),
            normals: leaf(&t.normals),
            offsets: leaf(&t.offsets),
            screen: leaf(&screen),
            splats: parameters.splats().clone(),
        })
    }

    /// Takes the gradients out of a finished backward pass; none when the image did not reach the loss.
    pub fn gradients(&self, grads: &mut burn::tensor::Gradients) -> Option<SplatGradients> {
        Some(SplatGradients {
            means: self.means.grad_remove(grads)?,
            rotations: self.rotations.grad_remove(grads)?,
            log_scales: self.log_scales.grad_remove(grads)?,
            opacity_logits: self.opacity_logits.grad_remove(grads)?,
            sh: self.sh.grad_remove(grads)?,
            screen: self.screen.grad_remove(grads)?,
            planes: self.normals.grad_remove(grads).zip(self.offsets.grad_remove(grads)),
        })
    }
}

/// Rasterizes tracked Gaussians: image `[H, W, 3]` on the autodiff graph, and the pass's scratch memory (radii and intersection
/// count), which stays valid as long as it is held.
///
/// # Errors
/// Not enough memory.
pub fn rasterized(raster: &Rasterizer, leaves: &Leaves, view: &RasterView) -> Result<(Tensor<3>, Forward), GpuError> {
    let (gpu, splats) = (raster.gpu().clone(), leaves.splats.clone());
    let image = empty(&gpu, "image", &[view.camera.height as usize, view.camera.width as usize, 3])?;
    let forward = raster.forward(&splats, view, Keep::Gradients, bind(&image))?;
    let pass = forward.clone();
    let parents = [
        on_graph(leaves.means.clone()),
        on_graph(leaves.rotations.clone()),
        on_graph(leaves.log_scales.clone()),
        on_graph(leaves.opacity_logits.clone()),
        on_graph(leaves.sh.clone()),
        on_graph(leaves.screen.clone()),
        on_graph(leaves.normals.clone()),
        on_graph(leaves.offsets.clone()),
    ];
    let image = node(parents, |tensors| {
        let shapes = tensors.map(|tensor| tensor.meta.shape().to_vec());
        let rule = move |v_image: &CubeTensor, _| {
            let has_planes = pass.surface().is_some();
            let count = if has_planes { 8 } else { 6 };
            let gradients: [Option<CubeTensor>; 8] =
                std::array::from_fn(|i| (i < count).then(|| empty_like(v_image, &shapes[i])));
            let gradient = |i: usize| gradients[i].as_ref().expect("six gradients or eight");
            let memory = |i: usize| bind(gradient(i));
            let v = RasterGradients {
                means: memory(0),
                rotations: bind_rows(gradient(1)),
                log_scales: memory(2),
                opacity_logits: memory(3),
                sh: memory(4),
                screen: bind_rows(gradient(5)),
                planes: has_planes.then(|| [memory(6), memory(7)]),
            };
            pass.backward(&gpu, &splats, &bind(v_image), &v);
            gradients
        };
        Ok::<_, GpuError>((image, rule))
    })?;
    Ok((image, forward))
}
