//! The rasterizer as a burn autodiff operation.

use super::{Forward, Inputs, RasterView, Rasterizer, tile_grid};
use crate::gpu::buffer::primitive;
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
use ibgs_shaders::{PLANES_BACKWARD, PROJECT_BACKWARD, RASTERIZE_BACKWARD, RASTERIZE_SURFACE_BACKWARD};
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
    /// `[N, 3]`
    pub normals: Tensor<2>,
    /// `[N]`
    pub offsets: Tensor<1>,
    /// `[N]`: sizes of the 3D smoothing filters, which have no gradient.
    pub filters: Tensor<1>,
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
    /// By the raw normals and offsets of the planes; none without a surface.
    pub planes: Option<(Tensor<2>, Tensor<1>)>,
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
            normals: splats.normals.val().autodiff().require_grad(),
            offsets: splats.offsets.val().autodiff().require_grad(),
            filters: splats.filters.val(),
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
            planes: self.normals.grad_remove(grads).zip(self.offsets.grad_remove(grads)),
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

impl Backward<CubeBackend, 8> for RasterizeBackward {
    type State = Saved;

    fn backward(self, ops: Ops<Saved, 8>, grads: &mut Gradients, _: &mut Checkpointer) {
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
    /// Gradients by means, rotations, log scales, opacities, SH, screen and, with a surface, normals and offsets.
    fn backward(&self, v_image: CubeTensor) -> Vec<CubeTensor> {
        let gpu = &*self.gpu;
        let Inputs { means, rotations, log_scales, opacity_logits, sh, normals, offsets, filters: _ } = &self.inputs;
        let v_image = burn_wgpu::into_contiguous(v_image);
        let zeros = |t: &CubeTensor| gpu.empty_like_shape(means, t.meta.shape());
        let mut outputs = [means, rotations, log_scales, opacity_logits, sh].map(zeros).to_vec();
        outputs.push(gpu.empty_like_shape(means, &[self.inputs.count(), 4]));
        if self.forward.surface.is_some() {
            outputs.extend([normals, offsets].map(zeros));
        }
        let bound_out: Vec<_> = outputs.iter().map(Gpu::bind).collect();
        let bound_v_image = Gpu::bind(&v_image);
        let mut pass = Pass::new(gpu, "rasterize backward");
        self.record_blend(&mut pass, &bound_v_image);
        self.record_project(&mut pass, &bound_out.iter().map(|b| &**b).collect::<Vec<_>>());
        pass.submit();
        outputs
    }

    fn record_blend(&self, pass: &mut Pass, v_image: &Buffer) {
        let ws = &self.forward.workspace;
        let frame = &self.forward.frame;
        let sorted = self.forward.sorted;
        let grid = tile_grid(frame);
        let (list, isects) = (self.forward.sorted_gaussians(), &ws.tile_sort.values[sorted]);
        match &self.forward.surface {
            None => {
                let [v_color, v_xy, v_cov] = [0, 1, 2].map(|i| &ws.rows[i]);
                let blend: [&Buffer; 10] = [
                    &ws.projected,
                    list,
                    isects,
                    &ws.tile_ranges,
                    &ws.final_t,
                    &ws.last_entry,
                    v_image,
                    v_color,
                    v_xy,
                    v_cov,
                ];
                pass.grid(&RASTERIZE_BACKWARD, &blend, bytes_of(frame), grid);
            }
            Some(s) => {
                let v = s.v.as_ref().expect("a tracked surface has gradients");
                let [v_color, v_xy, v_cov, v_plane] = [0, 1, 2, 3].map(|i| &ws.rows[i]);
                let blend: [&Buffer; 18] = [
                    &ws.projected,
                    &s.planes,
                    list,
                    isects,
                    &ws.tile_ranges,
                    &ws.final_t,
                    &ws.last_entry,
                    &s.median_depth,
                    &s.slots,
                    &s.slot_entries,
                    v_image,
                    &v.normal_map,
                    &v.median_depth,
                    &v.slots,
                    v_color,
                    v_xy,
                    v_cov,
                    v_plane,
                ];
                pass.grid(&RASTERIZE_SURFACE_BACKWARD, &blend, bytes_of(&s.frame), grid);
            }
        }
    }

    fn record_project(&self, pass: &mut Pass, out: &[&Buffer]) {
        let Inputs { means, rotations, log_scales, sh, normals, offsets, filters, .. } = &self.inputs;
        let bound = [means, rotations, log_scales, sh, normals, offsets, filters].map(Gpu::bind);
        let [means, rotations, log_scales, sh, normals, offsets, filters] = bound.each_ref().map(|b| &**b);
        let ws = &self.forward.workspace;
        let (frame, order) = (bytes_of(&self.forward.frame), &ws.depth_sort.values[0]);
        let count = self.inputs.count();
        let project: [&Buffer; 18] = [
            means,
            rotations,
            log_scales,
            sh,
            &ws.projected,
            order,
            &ws.offsets,
            &ws.tile_counts,
            &ws.rows[0],
            &ws.rows[1],
            &ws.rows[2],
            out[0],
            out[1],
            out[2],
            out[3],
            out[4],
            out[5],
            filters,
        ];
        pass.linear(&PROJECT_BACKWARD, &project, frame, count);
        if let Some(s) = &self.forward.surface {
            let planes: [&Buffer; 11] = [
                means,
                normals,
                offsets,
                &s.planes,
                order,
                &ws.offsets,
                &ws.tile_counts,
                &ws.rows[3],
                out[0],
                out[6],
                out[7],
            ];
            pass.linear(&PLANES_BACKWARD, &planes, frame, count);
        }
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
        let normals = leaves.normals.clone().try_into_primitive::<Ad>().expect(on_graph);
        let offsets = leaves.offsets.clone().try_into_primitive::<Ad>().expect(on_graph);
        let nodes = [
            means.node(),
            rotations.node(),
            log_scales.node(),
            opacity_logits.node(),
            sh.node(),
            screen.node(),
            normals.node(),
            offsets.node(),
        ];
        let inputs = Inputs {
            means: means.into_primitive(),
            rotations: rotations.into_primitive(),
            log_scales: log_scales.into_primitive(),
            opacity_logits: opacity_logits.into_primitive(),
            sh: sh.into_primitive(),
            normals: normals.into_primitive(),
            offsets: offsets.into_primitive(),
            filters: primitive(leaves.filters.clone()),
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
