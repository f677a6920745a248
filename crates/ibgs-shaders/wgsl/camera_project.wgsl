//! Gradient of the projection by the camera.
#set train
#stage project backward
// A fixed number of workgroups, each over its share of the Gaussians. It reads what project_backward.wgsl reads, so it runs before.
#import frame
#import room
#import gaussian
#import ewa_backward
#import sh
#import camera_sums

@group(0) @binding(0) var<storage, read> means: array<f32>;
@group(0) @binding(1) var<storage, read> rotations: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> log_scales: array<f32>;
@group(0) @binding(3) var<storage, read> sh: array<f32>;
@group(0) @binding(4) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(6) var<storage, read> total: array<u32>;
@group(0) @binding(7) var<storage, read> v_rotations: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> v_log_scales: array<f32>;
@group(0) @binding(9) var<storage, read> v_means: array<f32>;
@group(0) @binding(10) var<storage, read_write> partials: array<vec4<f32>>;

// By the direction that the Gaussian's colour is seen from.
fn by_direction(g: u32, offset: vec3<f32>) -> vec3<f32> {
    let v_color = select(vec3(0.0), v_rotations[g].rgb, projected[3u * g + 2u].rgb > vec3(0.0));
    let direction = normalize(offset);
    var v_direction = vec3(0.0);
    for (var c = 1u; c < sh_count(frame.sh_degree); c++) {
        let at = 3u * (frame.sh_coefficients * g + c);
        v_direction += dot(v_color, vec3(sh[at], sh[at + 1u], sh[at + 2u])) * sh_basis_gradient(direction, c);
    }
    return along_sphere(offset, v_direction);
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    var sum: CameraGradient;
    let overflow = ran_out_of_room();
    for (var g = wid.x * THREADS + local; g < frame.count; g += CAMERA_GROUPS * THREADS) {
        if overflow || tile_counts[g] == 0u {
            continue;
        }
        let mean = vec3(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]);
        let scale = exp(vec3(log_scales[3u * g], log_scales[3u * g + 1u], log_scales[3u * g + 2u]));
        let rq = quaternion_matrix(normalize(rotations[g]));
        let axes = mat3x3<f32>(view_rotate(rq[0]), view_rotate(rq[1]), view_rotate(rq[2]));
        let view = view_rotate(mean) + view_translation();
        let by_xy = vec2(v_means[3u * g], v_means[3u * g + 1u]);
        let by_cov = vec3(v_log_scales[3u * g], v_log_scales[3u * g + 1u], v_log_scales[3u * g + 2u]);
        let v = ewa_backward(ewa_project(view, axes, scale), view, axes, scale, by_xy, by_cov);
        // A turn leaves the camera's centre where it is, and with it the direction of the colour.
        sum.translation += v.view + view_rotate(by_direction(g, mean - frame.center));
        sum.rotation += cross(view, v.view);
        for (var c = 0u; c < 3u; c++) {
            sum.rotation += scale[c] * cross(axes[c], v.spread[c]);
        }
        sum.focal += v.focal;
        sum.principal += by_xy;
    }
    store_camera(local, 3u * wid.x, sum);
}
