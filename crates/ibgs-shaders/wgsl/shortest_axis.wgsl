//! Plane normals from the shortest axes.
#set render
#stage other
// One thread a Gaussian: its plane's normal becomes its shortest axis, its offset 0 (method.md section 1).
#import index
#import frame
#import gaussian

@group(0) @binding(0) var<storage, read> rotations: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> log_scales: array<f32>;
@group(0) @binding(2) var<storage, read_write> normals: array<f32>;
@group(0) @binding(3) var<storage, read_write> plane_offsets: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    if i >= frame.count {
        return;
    }
    let axes = quaternion_matrix(normalize(rotations[i]));
    let scale = vec3(log_scales[3u * i], log_scales[3u * i + 1u], log_scales[3u * i + 2u]);
    var axis = select(axes[1], axes[0], scale.x <= scale.y);
    axis = select(axis, axes[2], scale.z < min(scale.x, scale.y));
    for (var c = 0u; c < 3u; c++) {
        normals[3u * i + c] = axis[c];
    }
    plane_offsets[i] = 0.0;
}
