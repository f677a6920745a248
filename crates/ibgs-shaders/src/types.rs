//! Host twins of the WGSL structs that travel as immediate data. Offsets are compared with the WGSL by the contract test.

mod half;

use bytemuck::{Pod, Zeroable};
pub use half::*;

/// One target view; the twin of `ViewUniforms` in `wgsl/shared/frame.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ViewUniforms {
    /// Rows of [R | t] with `x_view = R x_world + t`.
    pub row0: [f32; 4],
    /// Second row.
    pub row1: [f32; 4],
    /// Third row.
    pub row2: [f32; 4],
    /// Focal lengths in pixels.
    pub focal: [f32; 2],
    /// Principal point minus one half: the pixel with index x lies at x.
    pub principal: [f32; 2],
    /// Camera centre in world space.
    pub center: [f32; 3],
    /// Number of Gaussians.
    pub count: u32,
    /// Image size in pixels.
    pub size: [u32; 2],
    /// Gaussians whose hash with the seed is smaller are left out; 0: none.
    pub dropout_below: u32,
    /// Seed of that hash.
    pub dropout_seed: u32,
    /// Background colour.
    pub background: [f32; 3],
    /// Active spherical-harmonics degree.
    pub sh_degree: u32,
    /// Stored coefficients a channel.
    pub sh_coefficients: u32,
    /// Length of the intersection buffers.
    pub capacity: u32,
    /// Half side of the box that a Gaussian is cut by, in standard deviations; 0: none.
    pub box_sigma: f32,
    /// x/z and y/z are clamped to this many tan(half field of view) in the projection's Jacobian.
    pub tangent_limit: f32,
}

/// Rays and planes of a target view; the twin of `SurfaceUniforms` in `wgsl/shared/surface.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfaceUniforms {
    /// Background colour.
    pub background: [f32; 3],
    /// Median intersections a pixel.
    pub intersections: u32,
    /// Focal lengths in pixels.
    pub focal: [f32; 2],
    /// The ray of the pixel with index x passes through (x - principal) / focal.
    pub principal: [f32; 2],
    /// Image size in pixels.
    pub size: [u32; 2],
    /// Image size in tiles.
    pub tiles: [u32; 2],
}

/// One source view beside a target view; the twin of `SourceParams` in `wgsl/shared/source.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SourceParams {
    /// Rows of [R | t] that take the target's view space to the source's.
    pub row0: [f32; 4],
    /// Second row.
    pub row1: [f32; 4],
    /// Third row.
    pub row2: [f32; 4],
    /// The target's focal lengths in pixels.
    pub focal: [f32; 2],
    /// The target's principal point, as in [`SurfaceUniforms`].
    pub principal: [f32; 2],
    /// The source's focal lengths in pixels.
    pub source_focal: [f32; 2],
    /// The source's principal point: its texel with index x lies at x.
    pub source_principal: [f32; 2],
    /// The target's size in pixels.
    pub size: [u32; 2],
    /// The source's size in pixels.
    pub source_size: [u32; 2],
    /// Number of the source among the target's sources.
    pub index: u32,
    /// Visible sources a pixel, V.
    pub visible: u32,
    /// Median intersections a pixel.
    pub intersections: u32,
    /// The depths of source and point agree when they differ by less than this part of the latter.
    pub agreement: f32,
    /// A source is packed when they differ by less than this many times that.
    pub reach: f32,
    /// Unused.
    pub pad0: u32,
    /// Unused.
    pub pad1: [u32; 2],
}

/// What is shown of a frame; the twin of `PresentParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PresentParams {
    /// Width and height.
    pub size: [u32; 2],
    /// Pixels from one row to the next.
    pub stride: u32,
    /// A [`Presented`](crate::Presented).
    pub mode: u32,
    /// Depth of the brightest and of the darkest colour.
    pub range: [f32; 2],
    /// Number of sources that has the brightest colour.
    pub most: u32,
    /// Differences are amplified by this factor.
    pub gain: f32,
}

/// The image loss and the photometric loss; the twin of `LossParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LossParams {
    /// Image size in pixels.
    pub size: [u32; 2],
    /// Image size in tiles.
    pub tiles: [u32; 2],
    /// Colour behind the photo of an object.
    pub background: [f32; 3],
    /// 1: the photo shows an object over the background; 0: alpha under one half is masked.
    pub object: u32,
    /// Weight of 1 - SSIM.
    pub lambda: f32,
    /// Index m among the V visible sources of the warped image; 0 in the image loss.
    pub visible_index: u32,
    /// Padding.
    pub pad: [u32; 2],
}

/// One Adam step of one tensor; the twin of `AdamParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct AdamParams {
    /// Number of values.
    pub count: u32,
    /// Values a row.
    pub row: u32,
    /// Leading values of a row that step with `rate`.
    pub head: u32,
    /// Learning rate of the head.
    pub rate: f32,
    /// Learning rate of the rest of the row.
    pub rate_rest: f32,
    /// Decay of the first moment.
    pub beta1: f32,
    /// Decay of the second moment.
    pub beta2: f32,
    /// Added to the root of the corrected second moment.
    pub eps: f32,
    /// 1 / (1 - beta1^t).
    pub correction1: f32,
    /// 1 / (1 - beta2^t).
    pub correction2: f32,
    /// Share of a value of the rest that is lost, times its rate.
    pub decay_rest: f32,
}

/// An image in a photo's exposure; the twin of `ExposeParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ExposeParams {
    /// Colour behind the Gaussians.
    pub background: [f32; 3],
    /// Number of pixels.
    pub pixels: u32,
}

/// Colours of the visible sources; the twin of `VisibleParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct VisibleParams {
    /// Number of pixels.
    pub pixels: u32,
    /// Visible sources a pixel, V.
    pub visible: u32,
}

/// Random steps of the means; the twin of `McmcNoiseParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct McmcNoiseParams {
    /// Number of Gaussians.
    pub count: u32,
    /// Seed of this iteration.
    pub seed: u32,
    /// Gain of the steps of a transparent Gaussian.
    pub strength: f32,
}

/// Sizes of the 3D smoothing filters; the twin of `FilterParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct FilterParams {
    /// Number of Gaussians.
    pub count: u32,
    /// Number of cameras.
    pub cameras: u32,
    /// Size of a filter in pixels of the nearest camera.
    pub factor: f32,
}

/// Densification statistics; the twin of `ObserveParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ObserveParams {
    /// Image size in pixels.
    pub size: [u32; 2],
    /// Number of Gaussians.
    pub count: u32,
    /// Gradients of Gaussians nearer than this view depth count less.
    pub near_depth: f32,
    /// 1: largest norms in place of sums.
    pub largest: u32,
    /// 1: pixels of large error were counted.
    pub errors: u32,
}

/// Row gathering; the twin of `GatherParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct GatherParams {
    /// Values to write.
    pub count: u32,
    /// Values a row.
    pub row: u32,
    /// 1: rows of new Gaussians are zero.
    pub fresh_zero: u32,
    /// Padding.
    pub pad: u32,
}

/// Opacity reset; the twin of `OpacityResetParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct OpacityResetParams {
    /// Number of Gaussians.
    pub count: u32,
    /// The logit that no opacity may exceed.
    pub limit: f32,
}

/// A loss that is a weighted mean; the twin of `MeanParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MeanParams {
    /// Partial sums.
    pub count: u32,
    /// Weight of the mean.
    pub weight: f32,
}

/// The normal loss; the twin of `SurfaceParams` in `wgsl/shared/depth_normal.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfaceParams {
    /// Image size in pixels.
    pub size: [u32; 2],
    /// Focal lengths in pixels.
    pub focal: [f32; 2],
    /// Principal point minus one half: the pixel with index x lies at x.
    pub principal: [f32; 2],
    /// Weight of the loss.
    pub weight: f32,
    /// Padding.
    pub pad: f32,
}

/// A plane sweep; the twin of `SweepParams` in `wgsl/plane_sweep.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SweepParams {
    /// Image size in pixels.
    pub size: [u32; 2],
    /// Number of planes, at least 2.
    pub planes: u32,
    /// Number of sources.
    pub sources: u32,
    /// Focal lengths in pixels.
    pub focal: [f32; 2],
    /// Principal point minus one half: the pixel with index x lies at x.
    pub principal: [f32; 2],
    /// Inverse depth of the first plane.
    pub nearest: f32,
    /// Inverse depth of the last plane, above 0.
    pub farthest: f32,
    /// Padding.
    pub pad: [u32; 2],
}

/// A source of a plane sweep, in a buffer; the twin of `SweepSource`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SweepSource {
    /// Rows of [R | t] with `x_source = R x_target + t`.
    pub rows: [[f32; 4]; 3],
    /// Focal lengths in pixels.
    pub focal: [f32; 2],
    /// Principal point minus one half.
    pub principal: [f32; 2],
    /// Photo size in pixels, at least 2 each.
    pub size: [u32; 2],
    /// First texel of its photo among all.
    pub offset: u32,
    /// Padding.
    pub pad: u32,
}

/// Input of the residual network; the twin of `FeatureParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct FeatureParams {
    /// Rows of R with `x_view = R x_world + t`; the fourth number is not used.
    pub row0: [f32; 4],
    /// Second row.
    pub row1: [f32; 4],
    /// Third row.
    pub row2: [f32; 4],
    /// Focal lengths in pixels.
    pub focal: [f32; 2],
    /// Principal point minus one half: the pixel with index x lies at x.
    pub principal: [f32; 2],
    /// Image size in pixels.
    pub size: [u32; 2],
    /// Size at which the network runs.
    pub low: [u32; 2],
    /// Visible sources a pixel, at most four.
    pub visible: u32,
    /// A [`NetworkInputs`](crate::NetworkInputs).
    pub inputs: u32,
    /// A [`Aggregation`](crate::Aggregation).
    pub aggregation: u32,
    /// Workgroups of the backward pass.
    pub groups: u32,
    /// Inverse of the scale of gradients in half precision.
    pub unscale: f32,
    /// An [`Output`](crate::Output).
    pub output: u32,
    /// Padding.
    pub pad: [u32; 2],
}

/// Sum of the per-view MLP's gradients; the twin of `FeatureSumParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct FeatureSumParams {
    /// Weights a row.
    pub count: u32,
    /// Rows.
    pub groups: u32,
    /// Weights of a row that lie at the front of the network's.
    pub first: u32,
    /// Where the others lie.
    pub rest: u32,
}

/// The final colour; the twin of `ComposeParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ComposeParams {
    /// Image size in pixels.
    pub size: [u32; 2],
    /// Size at which the network ran.
    pub low: [u32; 2],
    /// Factor of the base colour.
    pub gain: f32,
    /// An [`Output`](crate::Output).
    pub output: u32,
    /// 1: pixels that see no source have the base colour.
    pub seen_only: u32,
    /// Visible sources a pixel, V.
    pub visible: u32,
}

/// The sources' share in the final colour; the twin of `MixParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MixParams {
    /// Number of pixels.
    pub pixels: u32,
    /// Visible sources a pixel, V.
    pub visible: u32,
    /// Most weight of the sources' mean colour.
    pub share: f32,
    /// Distance of the unit viewing directions at which a source counts 1/e.
    pub angle: f32,
    /// What stands against the sources' weights.
    pub doubt: f32,
}

/// A 3 x 3 convolution or its gradient by the input; the twin of `ConvParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ConvParams {
    /// Size of input and output in pixels.
    pub size: [u32; 2],
    /// Size of what input a is read from.
    pub source: [u32; 2],
    /// How input a is read: a [`ConvInput`](crate::ConvInput).
    pub mode: u32,
    /// Channels of input a.
    pub channels_a: u32,
    /// Channels of input b, behind those of a.
    pub channels_b: u32,
    /// Output channels, at most 40.
    pub outputs: u32,
    /// First weight.
    pub weights: u32,
    /// Distance between the weights of neighbouring outputs.
    pub stride_out: u32,
    /// Distance between the weights of neighbouring inputs.
    pub stride_in: u32,
    /// 1: the taps turned by half a circle.
    pub turned: u32,
    /// First bias.
    pub bias: u32,
    /// A [`Store`](crate::Store).
    pub store: u32,
    /// Groups of 20 outputs: 1 or 2.
    pub groups: u32,
    /// Padding.
    pub pad: u32,
}

/// Gradient of a 3 x 3 convolution's weights; the twin of `ConvWeightsParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ConvWeightsParams {
    /// Size of input and output in pixels.
    pub size: [u32; 2],
    /// Size of what the input is read from.
    pub source: [u32; 2],
    /// As [`ConvParams::mode`].
    pub mode: u32,
    /// Input channels, at most 38.
    pub inputs: u32,
    /// Output channels, at most 38.
    pub outputs: u32,
    /// Workgroups that share the image.
    pub splits: u32,
}

/// Sum of rows of partial sums; the twin of `SumParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SumParams {
    /// Rows.
    pub splits: u32,
    /// Values a row.
    pub stride: u32,
    /// Outputs of the layer.
    pub rows: u32,
    /// Weights of an output.
    pub length: u32,
    /// Where the first output's weights go.
    pub target_offset: u32,
    /// Distance to the next output's.
    pub target_stride: u32,
    /// Where the biases go.
    pub bias: u32,
    /// How many of them are wanted.
    pub biases: u32,
}

/// Gradient of the 2 x 2 maximum; the twin of `PoolParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PoolParams {
    /// Size before the maximum in pixels.
    pub size: [u32; 2],
    /// Channels.
    pub channels: u32,
    /// Padding.
    pub pad: u32,
}

/// Gradient of the enlargement; the twin of `UpsampleParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct UpsampleParams {
    /// Size after the enlargement in pixels.
    pub size: [u32; 2],
    /// Size before it.
    pub source: [u32; 2],
    /// Channels.
    pub channels: u32,
    /// Padding.
    pub pad: u32,
}

/// The U-Net's last two layers; the twin of `HeadParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HeadParams {
    /// Number of pixels.
    pub pixels: u32,
    /// First weight of the layer before the last.
    pub fuse: u32,
    /// Its first bias.
    pub fuse_bias: u32,
    /// First weight of the last layer.
    pub last: u32,
    /// Its first bias.
    pub last_bias: u32,
    /// 1: the values between the two layers are kept.
    pub keep: u32,
}

/// Multiply-adds in registers; the twin of `FmaParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct FmaParams {
    /// Threads.
    pub count: u32,
    /// Steps of [`BENCH_FMAS`](crate::BENCH_FMAS) multiply-adds.
    pub steps: u32,
}
