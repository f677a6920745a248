//! The weighted sum of two images.
#set render
#stage other
// One thread a value.
#import index

/// Weights of two images.
struct WeightedSumParams {
    /// Number of values.
    values: u32,
    /// Weight of the first image.
    first: f32,
    /// Weight of the second.
    second: f32,
}

var<immediate> params: WeightedSumParams;

@group(0) @binding(0) var<storage, read> a: array<f32>;
@group(0) @binding(1) var<storage, read> b: array<f32>;
@group(0) @binding(2) var<storage, read_write> sum: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    if i >= params.values {
        return;
    }
    sum[i] = params.first * a[i] + params.second * b[i];
}
