//! Sizes of the 3D smoothing filters.
#set train
#stage other
// One thread a Gaussian: the size of its 3D smoothing filter (Yu et al., "Mip-Splatting", CVPR 2024), a standard deviation that the
// nearest training camera can just resolve: `factor` pixels of that camera at the Gaussian's distance.
#import index

/// Sizes of the 3D smoothing filters.
struct FilterParams {
    /// Number of Gaussians.
    count: u32,
    /// Number of cameras.
    cameras: u32,
    /// Size of a filter in pixels of the nearest camera.
    factor: f32,
}

var<immediate> params: FilterParams;

@group(0) @binding(0) var<storage, read> means: array<f32>;
/// Centre of each training camera, and its larger focal length in pixels.
@group(0) @binding(1) var<storage, read> cameras: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> filters: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    if i >= params.count {
        return;
    }
    let mean = vec3(means[3u * i], means[3u * i + 1u], means[3u * i + 2u]);
    var least = 3e38;
    for (var c = 0u; c < params.cameras; c++) {
        let camera = cameras[c];
        least = min(least, distance(mean, camera.xyz) / camera.w);
    }
    filters[i] = params.factor * least;
}
