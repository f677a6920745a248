//! Plane of each Gaussian in camera space.
#set render
#stage planes
// One thread a Gaussian: its plane as the camera sees it, n_c and D_c (method.md section 3). All zero, which no ray
// meets, where the normal has no direction or a value is not finite.
#import index
#import frame
#import gaussian

@group(0) @binding(0) var<storage, read> means: array<f32>;
@group(0) @binding(1) var<storage, read> normals: array<f32>;
@group(0) @binding(2) var<storage, read> plane_offsets: array<f32>;
/// (n_c, D_c).
@group(0) @binding(3) var<storage, read_write> planes: array<vec4<f32>>;

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
    // n . (c - mu) + d is D - n_c . t without its cancellation.
    let to_camera = frame.center - vec3(means[3u * i], means[3u * i + 1u], means[3u * i + 2u]);
    let raw = vec3(normals[3u * i], normals[3u * i + 1u], normals[3u * i + 2u]);
    let flip = select(1.0, -1.0, dot(to_camera, raw) < 0.0);
    let normal = raw * (flip / length(raw));
    let plane = vec4(view_rotate(normal), abs(dot(normal, to_camera) + flip * plane_offsets[i]));
    let broken = not_finite3(plane.xyz) || not_finite(plane.w);
    planes[i] = select(plane, vec4(0.0), broken);
}
