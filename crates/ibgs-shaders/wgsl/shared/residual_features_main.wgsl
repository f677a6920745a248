// The kernel that makes the U-Net's input: features of the visible sources, per-view MLP, mean or mean by confidence over them, viewing
// ray and base colour (method.md section 6). Devices with subgroups of 8 lanes, which are processors, have a form of their own.
#import index
#import residual_features_rest

@group(0) @binding(0) var<storage, read> base: array<f32>;
@group(0) @binding(1) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> seen: array<u32>;
@group(0) @binding(3) var<storage, read> most_visible: array<u32>;
@group(0) @binding(4) var<storage, read> centers: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> weights: array<f32>;

const THREADS: u32 = 128u;

#if NARROW
#import residual_features_narrow
#else
#import residual_features_wide
#endif
