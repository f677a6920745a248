//! The mean of the images of an ensemble.
#set render
#stage compose
// One thread a value.
#import index

/// Weights of two images.
struct AverageParams {
    /// Number of values.
    values: u32,
    /// Weight of the first image.
    own: f32,
    /// Weight of the second.
    other: f32,
}

var<immediate> params: AverageParams;

@group(0) @binding(0) var<storage, read> image: array<f32>;
@group(0) @binding(1) var<storage, read> member: array<f32>;
@group(0) @binding(2) var<storage, read_write> mean: array<f32>;

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
    mean[i] = params.own * image[i] + params.other * member[i];
}
