//! The rasterizer.

use crate::parameters::Parameters;
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
use ibgs_core::raster::{Forward, Keep, RasterGradients, RasterView, Rasterizer};
use ibgs_core::scene::Splats;
use std::sync::Arc;

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
    /// When the device cannot bind so many screen-space gradients at once.
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

#[derive(Debug)]
struct RasterizeBackward;

#[derive(Clone, Debug)]
struct Saved {
    gpu: Arc<Gpu>,
    splats: Splats,
    forward: Forward,
    /// Shapes of the gradients, in the order of the parents.
    shapes: [Vec<usize>; 8],
}

impl Backward<CubeBackend, 8> for RasterizeBackward {
    type State = Saved;

    fn backward(self, ops: Ops<Saved, 8>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_image = contiguous(grads.consume::<CubeBackend>(&ops.node));
        let results = ops.state.backward(&v_image);
        for (parent, gradient) in ops.parents.into_iter().zip(results) {
            if let Some(node) = parent {
                grads.register::<CubeBackend>(node.id, gradient);
            }
        }
    }
}

impl Saved {
    /// Gradients by means, rotations, log scales, opacities, SH, screen and, with a surface, normals and offsets.
    fn backward(&self, v_image: &CubeTensor) -> Vec<CubeTensor> {
        let count = if self.forward.surface().is_some() { 8 } else { 6 };
        let tensors: Vec<_> = self.shapes[..count].iter().map(|shape| empty_like(v_image, shape)).collect();
        let mut memory = tensors.iter().map(bind);
        let mut next = || memory.next().expect("six tensors or eight");
        let gradients = RasterGradients {
            means: next(),
            rotations: next(),
            log_scales: next(),
            opacity_logits: next(),
            sh: next(),
            screen: next(),
            planes: (count == 8).then(|| [next(), next()]),
        };
        self.forward.backward(&self.gpu, &self.splats, &bind(v_image), &gradients);
        tensors
    }
}

/// Rasterizes tracked Gaussians: image `[H, W, 3]` on the autodiff graph, and the pass's scratch memory (radii and intersection
/// count), which stays valid as long as it is held.
///
/// # Errors
/// Not enough memory.
pub fn rasterized(raster: &Rasterizer, leaves: &Leaves, view: &RasterView) -> Result<(Tensor<3>, Forward), GpuError> {
    type Ad = Autodiff<CubeBackend>;
    let on_graph = "leaves are on the autodiff graph";
    let tensors = [
        leaves.means.clone().try_into_primitive::<Ad>().expect(on_graph),
        leaves.rotations.clone().try_into_primitive::<Ad>().expect(on_graph),
        leaves.log_scales.clone().try_into_primitive::<Ad>().expect(on_graph),
        leaves.opacity_logits.clone().try_into_primitive::<Ad>().expect(on_graph),
        leaves.sh.clone().try_into_primitive::<Ad>().expect(on_graph),
        leaves.screen.clone().try_into_primitive::<Ad>().expect(on_graph),
        leaves.normals.clone().try_into_primitive::<Ad>().expect(on_graph),
        leaves.offsets.clone().try_into_primitive::<Ad>().expect(on_graph),
    ];
    let nodes = tensors.each_ref().map(|tensor| tensor.node());
    let (gpu, size) = (raster.gpu(), [view.camera.height as usize, view.camera.width as usize, 3]);
    let image = empty(gpu, "image", &size)?;
    let forward = raster.forward(&leaves.splats, view, Keep::Gradients, bind(&image))?;
    let output = match RasterizeBackward.prepare::<NoCheckpointing>(nodes).compute_bound().stateful() {
        OpsKind::Tracked(prep) => {
            let shapes = tensors.map(|tensor| tensor.into_primitive().meta.shape().to_vec());
            let (gpu, splats) = (gpu.clone(), leaves.splats.clone());
            prep.finish(Saved { gpu, splats, forward: forward.clone(), shapes }, image)
        }
        OpsKind::UnTracked(prep) => prep.finish(image),
    };
    Ok((Tensor::from_primitive::<Ad>(output), forward))
}
