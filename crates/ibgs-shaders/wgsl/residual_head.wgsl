#stage unet
// One thread four pixels: f and the output of the U-Net's last two layers.
@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read_write> residual: array<vec4<f32>>;

#kernel residual_head
//! The U-Net's last two layers.
#set train
#import residual_head_main

@group(0) @binding(2) var<storage, read> d1: array<f32>;
@group(0) @binding(3) var<storage, read> x: array<f32>;
@group(0) @binding(4) var<storage, read_write> f: array<f32>;

fn keep(o: u32, pixels: vec4<u32>, values: vec4<f32>) {
    if params.keep == 0u || o >= WIDTH {
        return;
    }
    for (var k = 0u; k < 4u; k++) {
        if pixels[k] < params.pixels {
            f[o * params.pixels + pixels[k]] = values[k];
        }
    }
}

#kernel residual_head_packed
//! As [`RESIDUAL_HEAD`], with activations as halves, and without f.
#set render
#define PACKED
#import residual_head_main

@group(0) @binding(2) var<storage, read> d1: array<u32>;
@group(0) @binding(3) var<storage, read> x: array<u32>;

fn keep(o: u32, pixels: vec4<u32>, values: vec4<f32>) {}
