//! From base colour and warped source colours to the final image (method.md section 6), as a burn autodiff operation.

use super::compose::{Compose, ComposeBuffers, ComposeGradients};
use super::features::{FeatureGradients, FeatureInputs, FeatureScratch, Features, InputGradients};
use super::half::choice;
use super::hourglass::Hourglass;
use super::path::Path;
use super::variant::{Precision, Variant};
use crate::camera::Camera;
use crate::fuse::Seen;
use crate::gpu::buffer::{from_primitive, primitive};
use crate::gpu::pool::{Lease, Pool};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use burn_wgpu::CubeBackend;
use std::sync::Arc;

/// One target view's task.
#[derive(Clone, Debug)]
pub struct ResidualTask {
    /// The target camera.
    pub camera: Camera,
    /// Which sources its pixels see.
    pub seen: Arc<Lease<Seen>>,
    /// Factor of the base colour in the final one: under 1 during burn-in.
    pub gain: f32,
}

/// Runs the residual network; owns its scratch memory.
#[derive(Debug)]
pub struct Residual {
    gpu: Arc<Gpu>,
    pool: Arc<Pool<Scratch>>,
    variant: Variant,
    /// In half precision on the matrix units.
    half: bool,
}

/// Memory of one image size.
#[derive(Debug)]
struct Scratch {
    network: Path,
    size: [u32; 2],
    slots: u32,
    backward: Option<BackwardScratch>,
}

#[derive(Debug)]
struct BackwardScratch {
    features: FeatureScratch,
    v_residual: Buffer,
}

const LABEL: &str = "residual";

#[derive(Debug)]
struct ResidualBackward;

#[derive(Clone, Debug)]
struct Saved {
    gpu: Arc<Gpu>,
    scratch: Arc<Lease<Scratch>>,
    task: ResidualTask,
    variant: Variant,
    base: CubeTensor,
    warped: CubeTensor,
    weights: CubeTensor,
    image: CubeTensor,
}

impl Backward<CubeBackend, 3> for ResidualBackward {
    type State = Saved;

    fn backward(self, ops: Ops<Saved, 3>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_image = burn_wgpu::into_contiguous(grads.consume::<CubeBackend>(&ops.node));
        let inputs_learn = ops.parents[..2].iter().any(Option::is_some);
        let gradients = ops.state.backward(&v_image, inputs_learn);
        for (parent, gradient) in ops.parents.into_iter().zip(gradients) {
            if let Some((node, gradient)) = parent.zip(gradient) {
                grads.register::<CubeBackend>(node.id, gradient);
            }
        }
    }
}

impl Saved {
    fn features(&self) -> Features {
        Features::new(&self.task.camera, self.scratch.slots, self.variant)
    }

    fn compose(&self) -> Compose {
        Compose::new(self.scratch.size, self.variant, self.task.gain)
    }

    /// Records the final image into `self.image`.
    fn record(&self, pass: &mut Pass) {
        let [base, warped, weights, image] = [&self.base, &self.warped, &self.weights, &self.image].map(Gpu::bind);
        let (scratch, seen) = (&self.scratch, &self.task.seen);
        pass.relabel(LABEL);
        let inputs = feature_inputs(seen, &base, &warped, &weights);
        scratch.network.record_input(pass, &self.features(), &inputs);
        scratch.network.forward(pass, &weights);
        let residual = scratch.network.residual();
        let buffers = ComposeBuffers { active: &seen.active, seen: &seen.slots, base: &base, residual, image: &image };
        self.compose().record(pass, &buffers);
    }

    /// Gradients by base colour, warped colours (both only where `inputs_learn`) and weights.
    fn backward(&self, v_image: &CubeTensor, inputs_learn: bool) -> [Option<CubeTensor>; 3] {
        let gpu = &*self.gpu;
        let [base, warped, weights, v_image] = [&self.base, &self.warped, &self.weights, v_image].map(Gpu::bind);
        let empty = |like: &CubeTensor| gpu.empty_like_shape(&self.base, like.meta.shape());
        let [v_base, v_warped, v_weights] = [&self.base, &self.warped, &self.weights].map(empty);
        let [b_base, b_warped, b_weights] = [&v_base, &v_warped, &v_weights].map(Gpu::bind);
        let (scratch, seen) = (&self.scratch, &self.task.seen);
        let own = scratch.backward.as_ref().expect("a tracked pass has memory for its gradients");
        let mut pass = Pass::new(gpu, "residual backward");
        let composed = ComposeGradients {
            active: &seen.active,
            seen: &seen.slots,
            v_image: &v_image,
            v_residual: &own.v_residual,
            v_base: &b_base,
        };
        self.compose().record_backward(&mut pass, &composed);
        scratch.network.backward(&mut pass, &weights, &own.v_residual, &b_weights);
        let inputs = feature_inputs(seen, &base, &warped, &weights);
        let v_x = scratch.network.v_x();
        let gradients = FeatureGradients { v_x, v_weights: &b_weights, scratch: &own.features };
        self.features().record_backward(&mut pass, &inputs, &gradients);
        if inputs_learn {
            let v = InputGradients { v_warped: &b_warped, v_base: &b_base };
            self.features().record_inputs_backward(&mut pass, &inputs, &gradients, &v);
        }
        pass.submit();
        [inputs_learn.then_some(v_base), inputs_learn.then_some(v_warped), Some(v_weights)]
    }
}

fn feature_inputs<'a>(seen: &'a Seen, base: &'a Buffer, warped: &'a Buffer, weights: &'a Buffer) -> FeatureInputs<'a> {
    FeatureInputs { base, warped, seen: &seen.slots, active: &seen.active, centers: &seen.centers, weights }
}

impl Residual {
    /// A residual stage without any memory yet.
    pub fn new(gpu: Arc<Gpu>, variant: Variant, precision: Precision) -> Self {
        let half = precision == Precision::Auto && choice::pays(&gpu);
        Self { gpu, pool: Arc::default(), variant, half }
    }

    /// Whether an image of this size is large enough for the network at its factor; a smaller one has no residual.
    pub fn fits(&self, camera: &Camera) -> bool {
        Hourglass::fits(self.variant.factor.size([camera.width, camera.height]))
    }

    fn scratch(&self, task: &ResidualTask, slots: u32, gradients: bool) -> Result<Scratch, GpuError> {
        let gpu = &*self.gpu;
        let size = [task.camera.width, task.camera.height];
        let free = self.pool.take();
        if let Some(s) = free.filter(|s| s.size == size && s.slots == slots && (s.backward.is_some() || !gradients)) {
            return Ok(s);
        }
        self.pool.clear();
        let low = self.variant.factor.size(size);
        let backward = || {
            Ok(BackwardScratch {
                features: Features::new(&task.camera, slots, self.variant).scratch(gpu)?,
                v_residual: gpu.allocate("residual gradients", 12 * u64::from(low[0]) * u64::from(low[1]))?,
            })
        };
        Ok(Scratch {
            network: Path::new(gpu, low, gradients, self.half)?,
            size,
            slots,
            backward: gradients.then(backward).transpose()?,
        })
    }

    /// Memory and inputs of a pass.
    fn prepared(
        &self,
        task: &ResidualTask,
        [base, warped, weights]: [CubeTensor; 3],
        gradients: bool,
    ) -> Result<Saved, GpuError> {
        let slots = warped.meta.shape()[0] as u32;
        let scratch = Arc::new(self.pool.lease(self.scratch(task, slots, gradients)?));
        let image = self.gpu.empty_like_shape(&base, base.meta.shape());
        let (gpu, variant, task) = (self.gpu.clone(), self.variant, task.clone());
        Ok(Saved { gpu, scratch, task, variant, base, warped, weights, image })
    }

    /// Final image `[H, W, 3]` from base colour `[H, W, 3]` and warped colours `[V, P, 4]`.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// For an image that does not fit ([`Residual::fits`]): a bug of ours.
    pub fn render(
        &self,
        task: &ResidualTask,
        base: Tensor<3>,
        warped: Tensor<3>,
        weights: Tensor<1>,
    ) -> Result<Tensor<3>, GpuError> {
        let mut pass = Pass::new(&self.gpu, LABEL);
        let image = self.record(&mut pass, task, [base, warped], weights)?;
        pass.submit();
        Ok(image)
    }

    /// As [`Residual::render`], as a part of a pass, of base and warped colours.
    pub(crate) fn record(
        &self,
        pass: &mut Pass,
        task: &ResidualTask,
        [base, warped]: [Tensor<3>; 2],
        weights: Tensor<1>,
    ) -> Result<Tensor<3>, GpuError> {
        let inputs = [primitive(base), primitive(warped), primitive(weights)];
        let saved = self.prepared(task, inputs, false)?;
        saved.record(pass);
        let image = from_primitive(saved.image.clone());
        pass.keep(saved);
        Ok(image)
    }

    /// As [`Residual::render`] on the autodiff graph. Gradients flow into the weights, and into base and warped colours
    /// where these are tracked themselves.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// For an image that does not fit, or tensors that are not on the autodiff graph: bugs of ours.
    pub fn tracked(
        &self,
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
        let inputs = [base.into_primitive(), warped.into_primitive(), weights.into_primitive()];
        let saved = self.prepared(task, inputs, true)?;
        let mut pass = Pass::new(&self.gpu, LABEL);
        saved.record(&mut pass);
        pass.submit();
        let image = saved.image.clone();
        let output = match ResidualBackward.prepare::<NoCheckpointing>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish(saved, image),
            OpsKind::UnTracked(prep) => prep.finish(image),
        };
        Ok(Tensor::from_primitive::<Ad>(output))
    }
}
