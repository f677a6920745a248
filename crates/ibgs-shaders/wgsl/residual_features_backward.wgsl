//! Gradient of the per-view MLP by features and weights, a row of weights a workgroup.
#set train
#stage features backward
// Gradient of the per-view MLP: by the features (colour and cosine, at the network's size) and, summed over all pixels of
// a workgroup, by the MLP's weights. The hidden layers are recomputed, and the workgroups stride over the image. Devices with
// subgroups of 8 lanes, which are processors, have a form of their own.
#import residual_feature

@group(0) @binding(0) var<storage, read> base: array<f32>;
@group(0) @binding(1) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> seen: array<u32>;
@group(0) @binding(3) var<storage, read> most_visible: array<u32>;
@group(0) @binding(4) var<storage, read> centers: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> weights: array<f32>;
/// Planes [38][pixels].
@group(0) @binding(6) var<storage, read> v_x: array<f32>;
/// (rgb, cosine) of each visible source, [visible][pixels].
@group(0) @binding(7) var<storage, read_write> v_features: array<vec4<f32>>;
/// Rows of MLP_WEIGHTS and CONFIDENCE_WEIGHTS, one a workgroup.
@group(0) @binding(8) var<storage, read_write> partials: array<f32>;

#if NARROW
#import residual_features_backward_narrow
#else
#import residual_features_backward_wide
#endif
