//! The rasterizer as a burn autodiff operation.

use super::{Forward, Inputs, RasterView, Rasterizer};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::scene::Splats;
use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use burn_wgpu::CubeBackend;
use bytemuck::bytes_of;
use ibgs_shaders::{PROJECT_BACKWARD, RASTERIZE_BACKWARD};
use std::sync::Arc;

/// The Gaussians as leaves of one iteration's graph, and a zero tensor whose gradient is the screen-space one.
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
    /// `[N, 4]`: its gradient holds (x, y, |x|, |y|) by the projected mean in pixels, summed over pixels.
    pub screen: Tensor<2>,
}

/// Gradients of one backward pass, in the shapes of [`Leaves`].
pub struct RasterGradients {
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
}

impl Leaves {
    /// Tracks the Gaussians' parameters for one iteration.
    pub fn new(splats: &Splats) -> Self {
        let count = splats.len();
        // Never read or written by the forward pass: it only carries a gradient.
        let screen = Tensor::empty([count, 4], &splats.means.val().device());
        Self {
            means: splats.means.val().autodiff().require_grad(),
            rotations: splats.rotations.val().autodiff().require_grad(),
            log_scales: splats.log_scales.val().autodiff().require_grad(),
            opacity_logits: splats.opacity_logits.val().autodiff().require_grad(),
            sh: splats.sh.val().autodiff().require_grad(),
            screen: screen.autodiff().require_grad(),
        }
    }

    /// Takes the gradients out of a finished backward pass; none when the image did not reach the loss.
    pub fn gradients(&self, grads: &mut burn::tensor::Gradients) -> Option<RasterGradients> {
        Some(RasterGradients {
            means: self.means.grad_remove(grads)?,
            rotations: self.rotations.grad_remove(grads)?,
            log_scales: self.log_scales.grad_remove(grads)?,
            opacity_logits: self.opacity_logits.grad_remove(grads)?,
            sh: self.sh.grad_remove(grads)?,
            screen: self.screen.grad_remove(grads)?,
        })
    }
}

#[derive(Debug)]
struct RasterizeBackward;

#[derive(Clone, Debug)]
struct Saved {
    gpu: Arc<Gpu>,
    inputs: Inputs,
    forward: Forward,
}

impl Backward<CubeBackend, 6> for RasterizeBackward {
    type State = Saved;

    fn backward(self, ops: Ops<Saved, 6>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_image = grads.consume::<CubeBackend>(&ops.node);
        let results = ops.state.backward(v_image);
        for (parent, gradient) in ops.parents.into_iter().zip(results) {
            if let Some(node) = parent {
                grads.register::<CubeBackend>(node.id, gradient);
            }
        }
    }
}

impl Saved {
    fn backward(&self, v_image: CubeTensor) -> [CubeTensor; 6] {
        let gpu = &*self.gpu;
        let Inputs { means, rotations, log_scales, opacity_logits, sh } = &self.inputs;
        let v_image = burn_wgpu::into_contiguous(v_image);
        let outputs =
            [means, rotations, log_scales, opacity_logits, sh].map(|t| gpu.empty_like_shape(means, t.meta.shape()));
        let v_screen = gpu.empty_like_shape(means, &[self.inputs.count(), 4]);
        let bound_in = [means, rotations, log_scales, sh].map(Gpu::bind);
        let bound_out = outputs.each_ref().map(Gpu::bind);
        let bound_screen = Gpu::bind(&v_screen);
        let bound_v_image = Gpu::bind(&v_image);

        let ws = &self.forward.workspace;
        let frame = &self.forward.frame;
        let [v_color, v_xy, v_cov] = ws.rows.as_ref().expect("a tracked forward pass has gradient rows");
        let sorted = self.forward.sorted;
        let mut pass = Pass::new(gpu, "rasterize backward");
        let blend: [&Buffer; 10] = [
            &ws.projected,
            ws.sorted_gaussians(sorted),
            &ws.tile_sort.values[sorted],
            &ws.tile_ranges,
            &ws.final_t,
            &ws.last_entry,
            &bound_v_image,
            v_color,
            v_xy,
            v_cov,
        ];
        pass.grid(&RASTERIZE_BACKWARD, &blend, bytes_of(frame), [frame.tiles[0], frame.tiles[1], 1]);
        let [b_means, b_rotations, b_log_scales, b_sh] = &bound_in;
        let [o_means, o_rotations, o_log_scales, o_opacity, o_sh] = &bound_out;
        let project: [&Buffer; 17] = [
            b_means,
            b_rotations,
            b_log_scales,
            b_sh,
            &ws.projected,
            &ws.depth_sort.values[0],
            &ws.offsets,
            &ws.tile_counts,
            v_color,
            v_xy,
            v_cov,
            o_means,
            o_rotations,
            o_log_scales,
            o_opacity,
            o_sh,
            &bound_screen,
        ];
        pass.linear(&PROJECT_BACKWARD, &project, bytes_of(frame), self.inputs.count());
        pass.submit();
        let [m, r, s, o, h] = outputs;
        [m, r, s, o, h, v_screen]
    }
}

impl Rasterizer {
    /// Rasterizes tracked Gaussians: image `[H, W, 3]` on the autodiff graph, and the pass's scratch memory (radii and
    /// intersection count), which stays valid as long as it is held.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn tracked(&self, leaves: &Leaves, view: &RasterView) -> Result<(Tensor<3>, Forward), GpuError> {
        type Ad = Autodiff<CubeBackend>;
        let on_graph = "leaves are on the autodiff graph";
        let means = leaves.means.clone().try_into_primitive::<Ad>().expect(on_graph);
        let rotations = leaves.rotations.clone().try_into_primitive::<Ad>().expect(on_graph);
        let log_scales = leaves.log_scales.clone().try_into_primitive::<Ad>().expect(on_graph);
        let opacity_logits = leaves.opacity_logits.clone().try_into_primitive::<Ad>().expect(on_graph);
        let sh = leaves.sh.clone().try_into_primitive::<Ad>().expect(on_graph);
        let screen = leaves.screen.clone().try_into_primitive::<Ad>().expect(on_graph);
        let nodes =
            [means.node(), rotations.node(), log_scales.node(), opacity_logits.node(), sh.node(), screen.node()];
        let inputs = Inputs {
            means: means.into_primitive(),
            rotations: rotations.into_primitive(),
            log_scales: log_scales.into_primitive(),
            opacity_logits: opacity_logits.into_primitive(),
            sh: sh.into_primitive(),
        };
        let forward = self.forward(&inputs, view, true)?;
        let image = forward.image.clone();
        let output = match RasterizeBackward.prepare::<NoCheckpointing>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let saved = Saved { gpu: self.gpu.clone(), inputs, forward: forward.clone() };
                prep.finish(saved, image)
            }
            OpsKind::UnTracked(prep) => prep.finish(image),
        };
        Ok((Tensor::from_primitive::<Ad>(output), forward))
    }
}
