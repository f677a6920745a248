//! Features of the visible sources, per-view MLP and what joins them to the U-Net's input, with their derivatives
//! (method.md sections 5 and 6).

use super::layers::{CONFIDENCE, ENC1, FEATURES, HIDDEN, INPUT, MLP1, MLP2};
use super::variant::Variant;
use crate::camera::Camera;
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::sources::MAX_VISIBLE;
use ibgs_shaders::bindings::{
    HalfFeaturesBackwardBindings, HalfFeaturesBindings, ResidualFeaturesBackwardBindings, ResidualFeaturesBindings,
    ResidualFeaturesHalfBindings, ResidualFeaturesPackedBindings, ResidualFeaturesSumBindings,
    ResidualInputsBackwardBindings,
};
use ibgs_shaders::types::{F16, FeatureParams, FeatureSumParams};
use ibgs_shaders::{HALF_FEATURES, HALF_FEATURES_BACKWARD, Kernel, RESIDUAL_FEATURES_BACKWARD};

/// Most workgroups of the backward pass: enough to fill a large GPU, few enough that their sums stay small.
const GROUPS: u32 = 768;
/// The same of the kernels for the matrix units: two for each multiprocessor of a large GPU.
const HALF_GROUPS: u32 = 264;
/// Weights of the per-view MLP, the first of the flat vector.
pub const MLP_WEIGHTS: usize = ENC1.offset;
/// Weights of the confidence, the last of the flat vector.
const CONFIDENCE_WEIGHTS: usize = CONFIDENCE.end() - CONFIDENCE.offset;

// wgsl/shared/residual_mlp_layout.wgsl relies on this layout.
const _: () = assert!(MLP1.offset == 0 && MLP1.bias() == FEATURES * HIDDEN && MLP2.offset == MLP1.bias() + HIDDEN);
const _: () = assert!(MLP2.bias() == MLP2.offset + HIDDEN * HIDDEN && MLP_WEIGHTS == MLP2.bias() + HIDDEN);
const _: () = assert!(CONFIDENCE_WEIGHTS == HIDDEN + 2 && INPUT == 38);
// Matrix units of 16 x 16 take the numbers of a source, the one for the biases, and the error of the depth.
const _: () = assert!(FEATURES + 2 <= 16);

/// Sums of a workgroup of the backward pass.
const SUMS: usize = MLP_WEIGHTS + CONFIDENCE_WEIGHTS;
/// Bytes of the sums of all workgroups.
pub const SUMS_BYTES: u64 = 4 * GROUPS as u64 * SUMS as u64;
const _: () = assert!(HALF_GROUPS <= GROUPS);

/// What the network's input is made of. W x H is the image's size, P = W H.
#[derive(Clone, Copy, Debug)]
pub struct FeatureInputs<'a> {
    /// Base colour, `[P, 3]`, exposure-corrected where that is on.
    pub base: &'a Buffer<f32>,
    /// `[V][P]` of (colour of the visible source, cosine).
    pub warped: &'a Buffer<[f32; 4]>,
    /// `[P]` words; byte m is the number of visible source m, 255: there is none.
    pub seen: &'a Buffer<u32>,
    /// `[4]` words, the first: most visible sources of any pixel.
    pub most_visible: &'a Buffer<u32>,
    /// `[sources]` of (target camera centre - source camera centre, unused), world space.
    pub centers: &'a Buffer<[f32; 4]>,
    /// The network's flat weights.
    pub weights: &'a Buffer<f32>,
}

/// Scratch memory of the backward pass.
#[derive(Debug)]
pub struct FeatureScratch {
    /// Gradient by (colour, cosine) of each visible source at the network's size.
    v_features: Buffer<[f32; 4]>,
    partials: Buffer<f32>,
}

/// What the features' backward pass reads and writes besides the inputs.
#[derive(Clone, Copy, Debug)]
pub struct FeatureGradients<'a> {
    /// Gradient by the U-Net's input, read.
    pub v_x: GradientByX<'a>,
    /// Gradient by the network's weights: those of the per-view MLP and of the confidence are assigned, zeros to the latter
    /// where it is not read.
    pub v_weights: &'a Buffer<f32>,
    /// Scratch memory.
    pub scratch: &'a FeatureScratch,
}

/// A gradient by the U-Net's input.
#[derive(Clone, Copy, Debug)]
pub enum GradientByX<'a> {
    /// Planes, `[38][w h]`.
    Planes(&'a Buffer<f32>),
    /// For matrix units of 16 x 16.
    Halves {
        /// Channels last, `[w h][48]`.
        all: &'a Buffer<[F16; 4]>,
        /// Inverse of the scale that they are multiplied by.
        unscale: f32,
        /// Planes of the base colour's, `[3][w h]`, without the scale.
        base: &'a Buffer<f32>,
    },
}

/// Gradients by what the rasterizer and the warp gave, and what those through the gated mean difference are made from.
#[derive(Clone, Copy, Debug)]
pub struct InputGradients<'a> {
    /// The network's output, `[w h, 4]`.
    pub residual: &'a Buffer<[f32; 4]>,
    /// Gradient by the final colour, `[P, 3]`.
    pub v_image: &'a Buffer<f32>,
    /// `[V][P]` of (colour, cosine), assigned; zero where there is no visible source.
    pub v_warped: &'a Buffer<[f32; 4]>,
    /// `[P, 3]`, added to.
    pub v_base: &'a Buffer<f32>,
}

/// One target view's features: size, camera and variant.
#[derive(Clone, Copy, Debug)]
pub struct Features {
    params: FeatureParams,
}

impl Features {
    /// Features with `visible` sources a pixel (1 to [`MAX_VISIBLE`]) for a target camera.
    ///
    /// # Panics
    /// With another number of them: a bug of ours.
    pub fn new(camera: &Camera, visible: u32, variant: Variant) -> Self {
        assert!((1..=MAX_VISIBLE).contains(&visible), "one to four visible sources a pixel, not {visible}");
        let size = [camera.width, camera.height];
        let low = variant.factor.size(size);
        let r = camera.view_from_world.transpose();
        let row = |axis: glam::DVec3| axis.extend(0.0).as_vec4().to_array();
        let params = FeatureParams {
            row0: row(r.x_axis),
            row1: row(r.y_axis),
            row2: row(r.z_axis),
            focal: camera.focal.as_vec2().to_array(),
            principal: (camera.principal - 0.5).as_vec2().to_array(),
            size,
            low,
            visible,
            aggregation: variant.aggregation as u32,
            output: variant.output as u32,
            ..FeatureParams::default()
        };
        Self { params }
    }

    /// Width and height at which the network runs.
    pub fn low(&self) -> [u32; 2] {
        self.params.low
    }

    fn low_pixels(&self) -> usize {
        (self.params.low[0] * self.params.low[1]) as usize
    }

    /// Memory for the backward pass of this size and number of visible sources, or anything smaller.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn scratch(&self, gpu: &Gpu) -> Result<FeatureScratch, GpuError> {
        let features = self.params.visible as usize * self.low_pixels();
        Ok(FeatureScratch {
            v_features: gpu.allocate("gradients of the sources' features", features)?,
            partials: gpu.allocate("sums of the per-view network", GROUPS as usize * SUMS)?,
        })
    }

    /// Records the U-Net's input `x`, planes `[38][w h]`: 32 aggregated channels, unit viewing ray in world space,
    /// base colour.
    pub fn record(&self, pass: &mut Pass<'_>, inputs: &FeatureInputs<'_>, x: &Buffer<f32>) {
        let FeatureInputs { base, warped, seen, most_visible, centers, weights } = *inputs;
        let bindings = ResidualFeaturesBindings { base, warped, seen, most_visible, centers, weights, x };
        pass.linear(&bindings, &self.params, self.low_pixels());
    }

    /// The same as halves, two channels a word: `[19][w h]`.
    pub fn record_packed(&self, pass: &mut Pass<'_>, inputs: &FeatureInputs<'_>, x: &Buffer<u32>) {
        let FeatureInputs { base, warped, seen, most_visible, centers, weights } = *inputs;
        let bindings = ResidualFeaturesPackedBindings { base, warped, seen, most_visible, centers, weights, x };
        pass.linear(&bindings, &self.params, self.low_pixels());
    }

    /// The same in half precision, channels last and padded with zeros: `[w h][48]`.
    pub fn record_half(&self, pass: &mut Pass<'_>, inputs: &FeatureInputs<'_>, x: &Buffer<[F16; 4]>) {
        let FeatureInputs { base, warped, seen, most_visible, centers, weights } = *inputs;
        let bindings = ResidualFeaturesHalfBindings { base, warped, seen, most_visible, centers, weights, x };
        pass.linear(&bindings, &self.params, self.low_pixels());
    }

    /// The same with the per-view MLP on matrix units of 16 x 16, in subgroups of 32 lanes.
    pub fn record_on_units(&self, pass: &mut Pass<'_>, inputs: &FeatureInputs<'_>, x: &Buffer<[F16; 4]>) {
        let groups = self.groups(&HALF_FEATURES, HALF_GROUPS);
        let FeatureInputs { base, warped, seen, most_visible, centers, weights } = *inputs;
        let bindings = HalfFeaturesBindings { base, warped, seen, most_visible, centers, weights, x };
        pass.grid(&bindings, &self.params, [groups, 1, 1]);
    }

    /// Workgroups of a kernel whose workgroups go round over the pixels.
    fn groups(&self, kernel: &Kernel, most: u32) -> u32 {
        (self.low_pixels() as u32).div_ceil(kernel.workgroup[0]).min(most)
    }

    /// Records the gradient by the MLP's weights, and by the features into the scratch memory. It is all that burn-in
    /// needs, where only the network learns.
    pub fn record_backward(&self, pass: &mut Pass<'_>, inputs: &FeatureInputs<'_>, gradients: &FeatureGradients<'_>) {
        let FeatureInputs { base, warped, seen, most_visible, centers, weights } = *inputs;
        let FeatureGradients { v_x, v_weights, scratch: FeatureScratch { v_features, partials } } = *gradients;
        let groups = match v_x {
            GradientByX::Halves { all: v_x, unscale, .. } => {
                let groups = self.groups(&HALF_FEATURES_BACKWARD, HALF_GROUPS);
                let params = FeatureParams { unscale, groups, ..self.params };
                let bindings = HalfFeaturesBackwardBindings {
                    base,
                    warped,
                    seen,
                    most_visible,
                    centers,
                    weights,
                    v_x,
                    v_features,
                    partials,
                };
                pass.grid(&bindings, &params, [groups, 1, 1]);
                groups
            }
            GradientByX::Planes(v_x) => {
                let groups = self.groups(&RESIDUAL_FEATURES_BACKWARD, GROUPS);
                let params = FeatureParams { unscale: 1.0, groups, ..self.params };
                let bindings = ResidualFeaturesBackwardBindings {
                    base,
                    warped,
                    seen,
                    most_visible,
                    centers,
                    weights,
                    v_x,
                    v_features,
                    partials,
                };
                pass.grid(&bindings, &params, [groups, 1, 1]);
                groups
            }
        };
        let sum =
            FeatureSumParams { count: SUMS as u32, groups, first: MLP_WEIGHTS as u32, rest: CONFIDENCE.offset as u32 };
        pass.groups(&ResidualFeaturesSumBindings { partials, v_weights }, &sum, SUMS.div_ceil(HIDDEN));
    }

    /// Records the gradient by warped colours, cosines and base colour; to follow [`Self::record_backward`].
    pub fn record_inputs_backward(
        &self,
        pass: &mut Pass<'_>,
        inputs: &FeatureInputs<'_>,
        gradients: &FeatureGradients<'_>,
        out: &InputGradients<'_>,
    ) {
        let FeatureInputs { base, warped, seen, most_visible, .. } = *inputs;
        let FeatureGradients { v_x, scratch: FeatureScratch { v_features, .. }, .. } = *gradients;
        let InputGradients { residual, v_image, v_warped, v_base } = *out;
        let (v_x, base_plane) = match v_x {
            GradientByX::Planes(planes) => (planes, INPUT as u32 - 3),
            GradientByX::Halves { base, .. } => (base, 0),
        };
        let bindings = ResidualInputsBackwardBindings {
            seen,
            most_visible,
            v_x,
            v_features,
            base,
            warped,
            residual,
            v_image,
            v_warped,
            v_base,
        };
        let [width, height] = self.params.size;
        let pixels = (width * height) as usize;
        pass.linear(&bindings, &FeatureParams { base_plane, ..self.params }, pixels);
    }
}
