#stage unet
// A 3 x 3 convolution with zero padding over one or two inputs (two: a concatenation that is never stored), forward or,
// with the strides of the weights exchanged and the taps turned, the gradient by the input (method.md section 6).
//
// Devices with subgroups of 8 lanes, which are processors, have a form of their own.

/// A 3 x 3 convolution or its gradient by the input.
struct ConvParams {
    /// Size of input and output in pixels.
    size: vec2<u32>,
    /// Size of what input a is read from.
    source: vec2<u32>,
    /// How input a is read: a [`crate::ConvInput`].
    mode: u32,
    /// Channels of input a.
    channels_a: u32,
    /// Channels of input b, behind those of a.
    channels_b: u32,
    /// Output channels, at most 40.
    outputs: u32,
    /// First weight.
    weights: u32,
    /// Distance between the weights of neighbouring outputs.
    stride_out: u32,
    /// Distance between the weights of neighbouring inputs.
    stride_in: u32,
    /// 1: the taps turned by half a circle.
    turned: u32,
    /// First bias.
    bias: u32,
    /// A [`crate::Store`].
    store: u32,
    /// Groups of 20 outputs: 1 or 2.
    groups: u32,
    /// Padding.
    pad: u32,
}

var<immediate> params: ConvParams;

@group(0) @binding(0) var<storage, read> weights: array<f32>;

#kernel residual_conv
//! 3 x 3 convolution, forward or gradient by the input.
#set train
@group(0) @binding(1) var<storage, read> input_a: array<f32>;
@group(0) @binding(2) var<storage, read> input_b: array<f32>;
@group(0) @binding(3) var<storage, read_write> output: array<f32>;

#if NARROW
#import residual_conv_narrow
#else
#import residual_conv_wide
#endif

#kernel residual_conv_packed
//! As [`RESIDUAL_CONV`], forward, with activations as halves.
#set render
#define PACKED
@group(0) @binding(1) var<storage, read> input_a: array<u32>;
@group(0) @binding(2) var<storage, read> input_b: array<u32>;
@group(0) @binding(3) var<storage, read_write> output: array<u32>;

#if NARROW
#import residual_conv_narrow
#else
#import residual_conv_wide
#endif
