#stage features

#kernel residual_features
//! Features and per-view MLP: the U-Net's input.
#set train
#import residual_features_main

/// Planes [38][pixels].
@group(0) @binding(6) var<storage, read_write> x: array<f32>;

fn put(channel: u32, i: u32, v: vec4<f32>) {
    let plane = params.low.x * params.low.y;
    let at = channel * plane + i;
    x[at] = v.x;
    x[at + plane] = v.y;
    if channel < RAY_CHANNEL + 4u {
        x[at + 2u * plane] = v.z;
        x[at + 3u * plane] = v.w;
    }
}

#kernel residual_features_packed
//! As [`RESIDUAL_FEATURES`], as halves.
#set render
#define PACKED
#import residual_features_main
#import residual_map

/// Planes of words with two channels, [19][pixels].
@group(0) @binding(6) var<storage, read_write> x: array<u32>;

fn put(channel: u32, i: u32, v: vec4<f32>) {
    let plane = params.low.x * params.low.y;
    let at = (channel / 2u) * plane + i;
    x[at] = word(v.x, v.y);
    if channel < RAY_CHANNEL + 4u {
        x[at + plane] = word(v.z, v.w);
    }
}
