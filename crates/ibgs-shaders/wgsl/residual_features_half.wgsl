//! The U-Net's input in half precision, channels last, in float32 arithmetic.
#set matrix
#stage features
// The U-Net's input in half precision, channels last, padded with zeros, for matrix units that half_features.wgsl does not fit.
#import half
#import residual_features_main

/// [pixel][48 / 4].
@group(0) @binding(6) var<storage, read_write> x: array<vec4<f16>>;

fn put(channel: u32, i: u32, v: vec4<f32>) {
    x[12u * i + channel / 4u] = to_half(v);
    if channel == RAY_CHANNEL + 4u {
        x[12u * i + 10u] = vec4<f16>();
        x[12u * i + 11u] = vec4<f16>();
    }
}
