//! From base colour and warped source colours to the final image (method.md section 6), and the gradients by them.

use super::compose::{Compose, ComposeGradients, ComposeInputs};
use super::features::{FeatureGradients, FeatureInputs, FeatureScratch, Features, InputGradients};
use super::unet::{Arithmetic, UNet, choice};
use super::variant::{Precision, Variant};
use crate::camera::Camera;
use crate::gpu::pool::{Lease, Pool};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::raster::Keep;
use crate::sources::Seen;
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

/// Runs the residual network; owns its scratch memory, which clones share.
#[derive(Clone, Debug)]
pub struct Residual {
    gpu: Arc<Gpu>,
    pool: Arc<Pool<Scratch>>,
    variant: Variant,
    arithmetic: Arithmetic,
}

/// Memory of one image size.
#[derive(Debug)]
struct Scratch {
    network: UNet,
    size: [u32; 2],
    visible: u32,
    backward: Option<BackwardScratch>,
}

#[derive(Debug)]
struct BackwardScratch {
    features: FeatureScratch,
    v_residual: Buffer<[f32; 4]>,
}

const LABEL: &str = "residual";

/// What the final image is made from, on the device.
#[derive(Clone, Debug)]
pub struct ResidualInputs {
    /// Base colour, `[H, W, 3]`.
    pub base: Buffer<f32>,
    /// Warped colours, `[V, P, 4]`.
    pub warped: Buffer<[f32; 4]>,
    /// Visible sources a pixel, V.
    pub visible: u32,
    /// Flat weights of the network, `[WEIGHTS]`.
    pub weights: Buffer<f32>,
}

/// The final image and what its gradients need.
#[derive(Clone, Debug)]
pub struct ResidualPass {
    /// Final image, `[H, W, 3]`.
    pub image: Buffer<f32>,
    inputs: ResidualInputs,
    scratch: Arc<Lease<Scratch>>,
    task: ResidualTask,
    variant: Variant,
}

/// Where the gradients of the inputs go; contents before are overwritten.
#[derive(Clone, Copy, Debug)]
pub struct ResidualGradients<'a> {
    /// By the base colour, `[H, W, 3]`. Written in part where the colours do not learn.
    pub base: &'a Buffer<f32>,
    /// By the warped colours, `[V, P, 4]`; none where neither they nor the base colour learn.
    pub warped: Option<&'a Buffer<[f32; 4]>>,
    /// By the weights, `[WEIGHTS]`.
    pub weights: &'a Buffer<f32>,
}

impl ResidualPass {
    fn features(&self) -> Features {
        Features::new(&self.task.camera, self.scratch.visible, self.variant)
    }

    fn compose(&self) -> Compose {
        Compose::new(self.scratch.size, self.scratch.visible, self.variant, self.task.gain)
    }

    fn composed(&self) -> ComposeInputs<'_> {
        let Seen { most_visible, visible: seen, .. } = &**self.task.seen;
        let ResidualInputs { base, warped, .. } = &self.inputs;
        ComposeInputs { most_visible, seen, base, warped, residual: self.scratch.network.residual() }
    }

    fn record(&self, pass: &mut Pass) {
        let ResidualInputs { base, warped, weights, .. } = &self.inputs;
        let (scratch, seen) = (&self.scratch, &self.task.seen);
        pass.relabel(LABEL);
        let inputs = feature_inputs(seen, base, warped, weights);
        scratch.network.record_input(pass, &self.features(), &inputs);
        scratch.network.forward(pass, weights);
        self.compose().record(pass, &self.composed(), &self.image);
    }

    /// Gradients from that of the final image, `[H, W, 3]`.
    ///
    /// # Panics
    /// When the pass was made without memory for gradients: a bug of ours.
    pub fn backward(&self, gpu: &Gpu, v_image: &Buffer<f32>, v: &ResidualGradients) {
        let ResidualInputs { base, warped, weights, .. } = &self.inputs;
        let (scratch, seen) = (&self.scratch, &self.task.seen);
        let own = scratch.backward.as_ref().expect("a tracked pass has memory for its gradients");
        let mut pass = Pass::new(gpu, "residual backward");
        let composed = ComposeGradients { v_image, v_residual: &own.v_residual, v_base: v.base };
        self.compose().record_backward(&mut pass, &self.composed(), &composed);
        scratch.network.backward(&mut pass, weights, &own.v_residual, v.weights);
        let inputs = feature_inputs(seen, base, warped, weights);
        let gradients = FeatureGradients { v_x: scratch.network.v_x(), v_weights: v.weights, scratch: &own.features };
        self.features().record_backward(&mut pass, &inputs, &gradients);
        if let Some(v_warped) = v.warped {
            let residual = scratch.network.residual();
            let v = InputGradients { residual, v_image, v_warped, v_base: v.base };
            self.features().record_inputs_backward(&mut pass, &inputs, &gradients, &v);
        }
        pass.submit();
    }
}

fn feature_inputs<'a>(
    seen: &'a Seen,
    base: &'a Buffer<f32>,
    warped: &'a Buffer<[f32; 4]>,
    weights: &'a Buffer<f32>,
) -> FeatureInputs<'a> {
    FeatureInputs {
        base,
        warped,
        seen: &seen.visible,
        most_visible: &seen.most_visible,
        centers: &seen.centers,
        weights,
    }
}

impl Residual {
    /// A residual stage without any memory yet.
    pub fn new(gpu: Arc<Gpu>, variant: Variant, precision: Precision) -> Self {
        let arithmetic = choice::arithmetic(&gpu, precision);
        Self { gpu, pool: Arc::default(), variant, arithmetic }
    }

    /// The GPU it works on.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Whether an image of this size is large enough for the network at its factor; a smaller one has no residual.
    pub fn fits(&self, camera: &Camera) -> bool {
        UNet::fits(self.variant.factor.size([camera.width, camera.height]))
    }

    fn scratch(&self, task: &ResidualTask, visible: u32, keep: Keep) -> Result<Scratch, GpuError> {
        let gpu = &*self.gpu;
        let size = [task.camera.width, task.camera.height];
        let gradients = keep == Keep::Gradients;
        // What has room for gradients does for a frame too, but where the activations of frames are others.
        let shared = self.arithmetic != Arithmetic::Packed;
        let keeps = |s: &Scratch| s.backward.is_some() == gradients || s.backward.is_some() && shared;
        if let Some(s) = self.pool.take().filter(|s| s.size == size && s.visible == visible && keeps(s)) {
            return Ok(s);
        }
        self.pool.clear();
        let low = self.variant.factor.size(size);
        let backward = || {
            Ok(BackwardScratch {
                features: Features::new(&task.camera, visible, self.variant).scratch(gpu)?,
                v_residual: gpu.allocate("residual gradients", low[0] as usize * low[1] as usize)?,
            })
        };
        Ok(Scratch {
            network: UNet::new(gpu, low, keep, self.arithmetic)?,
            size,
            visible,
            backward: gradients.then(backward).transpose()?,
        })
    }

    /// Final image, `[H, W, 3]`, into `image`.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// For an image that does not fit ([`Residual::fits`]): a bug of ours.
    pub fn forward(
        &self,
        task: &ResidualTask,
        inputs: ResidualInputs,
        keep: Keep,
        image: Buffer<f32>,
    ) -> Result<ResidualPass, GpuError> {
        let mut pass = Pass::new(&self.gpu, LABEL);
        let forward = self.record(&mut pass, task, inputs, keep, image)?;
        pass.submit();
        Ok(forward)
    }

    /// As [`Residual::forward`], as a part of a pass, which has to keep what this returns until it is submitted.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// As [`Residual::forward`].
    pub fn record(
        &self,
        pass: &mut Pass,
        task: &ResidualTask,
        inputs: ResidualInputs,
        keep: Keep,
        image: Buffer<f32>,
    ) -> Result<ResidualPass, GpuError> {
        let scratch = Arc::new(self.pool.lease(self.scratch(task, inputs.visible, keep)?));
        let forward = ResidualPass { image, inputs, scratch, task: task.clone(), variant: self.variant };
        forward.record(pass);
        Ok(forward)
    }
}
