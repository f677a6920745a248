//! 3 x 3 convolution, partial sums of the gradient by weights and biases.
#set train
#stage unet weights
// Gradient of a 3 x 3 convolution's weights and biases: dW[o][i][tap] = sum over pixels of v[o][p] x[i][p + tap].
//
// Each workgroup walks through a part of the image and writes one row of partial sums. Devices with subgroups of 8 lanes, which are
// processors, have a form of their own.

/// Gradient of a 3 x 3 convolution's weights.
struct ConvWeightsParams {
    /// Size of input and output in pixels.
    size: vec2<u32>,
    /// Size of what the input is read from.
    source: vec2<u32>,
    /// As [`ConvParams::mode`].
    mode: u32,
    /// Input channels, at most 38.
    inputs: u32,
    /// Output channels, at most 38.
    outputs: u32,
    /// Workgroups that share the image.
    splits: u32,
}

var<immediate> params: ConvWeightsParams;

@group(0) @binding(0) var<storage, read> v: array<f32>;
@group(0) @binding(1) var<storage, read> input: array<f32>;
/// [split][outputs * inputs * 9 weights, then outputs biases].
@group(0) @binding(2) var<storage, read_write> partials: array<f32>;

#if NARROW
#import residual_conv_weights_narrow
#else
#import residual_conv_weights_wide
#endif
