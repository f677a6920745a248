//! Of the kernels for matrix units.

use bytemuck::{Pod, Zeroable};

/// A layer's weights for the matrix units; the twin of `HalfWeights`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HalfWeights {
    /// First weight.
    pub weights: u32,
    /// Distance between the weights of neighbouring outputs.
    pub stride_out: u32,
    /// Distance between the weights of neighbouring inputs.
    pub stride_in: u32,
    /// Taps: 9 or 1.
    pub taps: u32,
    /// 1: the taps turned by half a circle.
    pub turned: u32,
    /// Channels of input a.
    pub channels_a: u32,
    /// Channels of input a with padding.
    pub padded_a: u32,
    /// Channels of input b.
    pub channels_b: u32,
    /// Channels of both inputs with padding.
    pub padded: u32,
    /// Output channels.
    pub outputs: u32,
    /// Groups of SIDE outputs.
    pub groups: u32,
    /// Where the result begins, in groups of 4; rises from layer to layer.
    pub into: u32,
}

/// All layers' weights for the matrix units; the twin of `HalfWeightsParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HalfWeightsParams {
    /// How many layers there are.
    pub layers: u32,
    /// Groups of 4 weights in all.
    pub quads: u32,
}

/// A 3 x 3 convolution on the matrix units; the twin of `HalfConvParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HalfConvParams {
    /// Size of the output in pixels.
    pub size: [u32; 2],
    /// Size of what input a is read from.
    pub source: [u32; 2],
    /// As [`ConvParams::mode`](super::ConvParams::mode).
    pub mode: u32,
    /// Values a pixel of input a, with padding, divided by 8.
    pub pairs_a: u32,
    /// The same of input b; 0: there is none.
    pub pairs_b: u32,
    /// Values a pixel of the output, with padding, divided by 4.
    pub quads_out: u32,
    /// Output channels.
    pub outputs: u32,
    /// First bias.
    pub bias: u32,
    /// Where the packed weights begin, in groups of 4.
    pub packed: u32,
    /// Groups of SIDE outputs of the packed weights.
    pub packed_groups: u32,
    /// As [`ConvParams::store`](super::ConvParams::store).
    pub store: u32,
    /// Padding.
    pub pad: u32,
}

/// The last two layers on the matrix units; the twin of `HalfHeadParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HalfHeadParams {
    /// Number of pixels.
    pub pixels: u32,
    /// First bias of the layer before the last.
    pub fuse_bias: u32,
    /// Where its packed weights begin, in groups of 4.
    pub fuse: u32,
    /// First bias of the last layer.
    pub last_bias: u32,
    /// Where its packed weights begin, in groups of 4.
    pub last: u32,
    /// 1: the input of the last layer is kept.
    pub keep: u32,
}

/// Gradient by the last layer's input; the twin of `HalfHeadGradientParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HalfHeadGradientParams {
    /// Number of pixels.
    pub pixels: u32,
    /// First weight of the last layer.
    pub last: u32,
    /// Gradients are multiplied by this, so that halves hold them.
    pub scale: f32,
}

/// Gradients by the inputs of the layer before the last; the twin of `HalfHeadBackwardParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HalfHeadBackwardParams {
    /// Number of pixels.
    pub pixels: u32,
    /// Where its packed weights begin, in groups of 4.
    pub fuse: u32,
}

/// Gradient of a convolution's weights on the matrix units; the twin of `HalfConvWeightsParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HalfConvWeightsParams {
    /// Size of input and output in pixels.
    pub size: [u32; 2],
    /// Size of what the input is read from.
    pub source: [u32; 2],
    /// As [`ConvParams::mode`](super::ConvParams::mode).
    pub mode: u32,
    /// Input channels.
    pub inputs: u32,
    /// The same with padding, divided by 8.
    pub pairs_in: u32,
    /// Output channels with padding, divided by 8.
    pub pairs_out: u32,
    /// Workgroups that share the image.
    pub splits: u32,
    /// Padding.
    pub pad: u32,
}

/// Gradient of a 1 x 1 convolution's weights on the matrix units; the twin of `HalfLinearWeightsParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HalfLinearWeightsParams {
    /// Pixels of input and output.
    pub pixels: u32,
    /// Input channels.
    pub inputs: u32,
    /// The same with padding, divided by 8.
    pub pairs_in: u32,
    /// Output channels with padding, divided by 8.
    pub pairs_out: u32,
    /// Workgroups that share the image.
    pub splits: u32,
}

/// Sum of rows of the partial sums of matrix units; the twin of `HalfSumParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HalfSumParams {
    /// Rows.
    pub splits: u32,
    /// Groups of input channels.
    pub groups_in: u32,
    /// Groups of output channels.
    pub groups_out: u32,
    /// 9 or 1.
    pub taps: u32,
    /// Input channels.
    pub inputs: u32,
    /// Output channels.
    pub outputs: u32,
    /// Where the first weight's gradient goes.
    pub into: u32,
    /// Distance to the next output's.
    pub stride: u32,
    /// Where the biases' go; 0: nowhere.
    pub bias: u32,
    /// Inverse of the gradients' scale.
    pub unscale: f32,
}

/// Gradients in half precision to planes; the twin of `HalfUnpackParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HalfUnpackParams {
    /// Number of pixels.
    pub pixels: u32,
    /// Number of planes.
    pub channels: u32,
    /// Values a pixel with padding, divided by 4.
    pub quads: u32,
    /// Inverse of the gradients' scale.
    pub unscale: f32,
}

/// Gradient of the 2 x 2 maximum or of the enlargement; the twin of `HalfResizeParams`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HalfResizeParams {
    /// The larger size.
    pub size: [u32; 2],
    /// The smaller size.
    pub source: [u32; 2],
    /// Values a pixel, divided by 4.
    pub quads: u32,
    /// Padding.
    pub pad: u32,
}
