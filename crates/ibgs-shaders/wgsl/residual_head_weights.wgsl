//! The U-Net's last two layers, partial sums of the gradient by weights and biases.
#set train
#stage unet weights
// Gradients of the weights and biases of the U-Net's last two layers. Each workgroup walks through a part of the image and writes one
// row of partial sums. Devices with subgroups of 8 lanes, which are processors, have a form of their own.
#import residual_head

@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read> d1: array<f32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;
@group(0) @binding(3) var<storage, read> f: array<f32>;
@group(0) @binding(4) var<storage, read> v_residual: array<vec4<f32>>;
/// [split][38 * 76 weights, 38 biases, 4 * 38 weights, 4 biases].
@group(0) @binding(5) var<storage, read_write> partials: array<f32>;

const STRIDE: u32 = WIDTH * INPUTS + WIDTH + OUTPUTS * WIDTH + OUTPUTS;

#if NARROW
#import residual_head_weights_narrow
#else
#import residual_head_weights_wide
#endif
