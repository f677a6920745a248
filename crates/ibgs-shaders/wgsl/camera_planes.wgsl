//! Gradient of the planes by the camera.
#set train
#stage planes backward
// A fixed number of workgroups, each over its share of the Gaussians. It reads what planes_backward.wgsl reads, so it runs before.
#import frame
#import room
#import camera_sums

@group(0) @binding(0) var<storage, read> means: array<f32>;
@group(0) @binding(1) var<storage, read> normals: array<f32>;
@group(0) @binding(2) var<storage, read> plane_offsets: array<f32>;
@group(0) @binding(3) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(5) var<storage, read> total: array<u32>;
@group(0) @binding(6) var<storage, read> v_normals: array<f32>;
@group(0) @binding(7) var<storage, read> v_plane_offsets: array<f32>;
@group(0) @binding(8) var<storage, read_write> partials: array<vec4<f32>>;

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    var sum: CameraGradient;
    let overflow = ran_out_of_room();
    for (var g = wid.x * THREADS + local; g < frame.count; g += CAMERA_GROUPS * THREADS) {
        let plane = planes[g];
        if overflow || tile_counts[g] == 0u || all(plane == vec4(0.0)) {
            continue;
        }
        let to_camera = frame.center - vec3(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]);
        let raw = vec3(normals[3u * g], normals[3u * g + 1u], normals[3u * g + 2u]);
        let flip = select(1.0, -1.0, dot(to_camera, raw) < 0.0);
        let distance = flip * (dot(raw / length(raw), to_camera) + plane_offsets[g]);
        let v_distance = select(-v_plane_offsets[g], v_plane_offsets[g], distance >= 0.0);
        sum.translation -= v_distance * plane.xyz;
        sum.rotation += cross(plane.xyz, vec3(v_normals[3u * g], v_normals[3u * g + 1u], v_normals[3u * g + 2u]));
    }
    store_camera(local, 3u * wid.x, sum);
}
