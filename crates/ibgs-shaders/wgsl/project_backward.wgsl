//! Gradient of the projection by the raw parameters.
#set train
#stage project backward
// One thread a Gaussian: carries the gradient from the projected quantities to the raw parameters (method.md sections 1 and 2).
// sum_rows.wgsl has left the former in v_rotations (colour, opacity), v_means and v_log_scales (covariance). In between the threads
// share the workgroup's coefficients, one after the other as they lie in memory. The gradient of the coefficients is the basis times
// that of the colour; only the latter is written.
#import index
#import frame
#import room
#import gaussian
#import ewa_backward
#import sh

@group(0) @binding(0) var<storage, read> means: array<f32>;
@group(0) @binding(1) var<storage, read> rotations: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> log_scales: array<f32>;
@group(0) @binding(3) var<storage, read> sh: array<f32>;
@group(0) @binding(4) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(6) var<storage, read> total: array<u32>;
@group(0) @binding(7) var<storage, read_write> v_means: array<f32>;
@group(0) @binding(8) var<storage, read_write> v_rotations: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> v_log_scales: array<f32>;
@group(0) @binding(10) var<storage, read_write> v_opacity_logits: array<f32>;
/// By the colour.
@group(0) @binding(11) var<storage, read_write> v_colors: array<f32>;

const THREADS: u32 = 128u;
// Coefficients of a Gaussian, and one so that lanes read different banks.
const ROW: u32 = 17u;

// Weights of each Gaussian's coefficients in the gradient by the direction.
var<workgroup> weights: array<f32, ROW * THREADS>;
var<workgroup> group_colors: array<vec3<f32>, THREADS>;

fn store_zero(g: u32) {
    for (var c = 0u; c < 3u; c++) {
        v_means[3u * g + c] = 0.0;
        v_log_scales[3u * g + c] = 0.0;
    }
    v_rotations[g] = vec4(0.0);
    v_opacity_logits[g] = 0.0;
}

// Leaves the weights of the coefficients of the workgroup's Gaussians, of which `first` is the first.
fn weigh_coefficients(local: u32, first: u32) {
    let all = frame.sh_coefficients;
    let active_count = sh_count(frame.sh_degree);
    for (var k = local; k < all * min(THREADS, frame.count - first); k += THREADS) {
        let in_group = k / all;
        let c = k % all;
        let v_color = group_colors[in_group];
        let at = 3u * (first * all + k);
        if c < active_count && any(v_color != vec3(0.0)) {
            weights[ROW * in_group + c] = dot(v_color, vec3(sh[at], sh[at + 1u], sh[at + 2u]));
        }
    }
}

// Gradient by the (unnormalised) viewing direction.
fn direction_backward(local: u32, offset: vec3<f32>) -> vec3<f32> {
    let direction = normalize(offset);
    var v_direction = vec3(0.0);
    if any(group_colors[local] != vec3(0.0)) {
        for (var c = 0u; c < sh_count(frame.sh_degree); c++) {
            v_direction += weights[ROW * local + c] * sh_basis_gradient(direction, c);
        }
    }
    return along_sphere(offset, v_direction);
}

fn rotation_backward(q: vec4<f32>, v: mat3x3<f32>) -> vec4<f32> {
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    // v[column][row].
    return 2.0 * vec4(
        z * (v[0][1] - v[1][0]) + y * (v[2][0] - v[0][2]) + x * (v[1][2] - v[2][1]),
        y * (v[1][0] + v[0][1]) + z * (v[2][0] + v[0][2]) - 2.0 * x * (v[1][1] + v[2][2]) + w * (v[1][2] - v[2][1]),
        x * (v[1][0] + v[0][1]) + z * (v[2][1] + v[1][2]) - 2.0 * y * (v[0][0] + v[2][2]) + w * (v[2][0] - v[0][2]),
        x * (v[2][0] + v[0][2]) + y * (v[2][1] + v[1][2]) - 2.0 * z * (v[0][0] + v[1][1]) + w * (v[0][1] - v[1][0]),
    );
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let first = linear_workgroup(wid, groups) * THREADS;
    if first >= frame.count {
        return;
    }
    let g = first + local;
    let counts = g < frame.count && !ran_out_of_room() && tile_counts[g] != 0u;
    group_colors[local] = vec3(0.0);
    if counts {
        let color = projected[3u * g + 2u].rgb;
        group_colors[local] = select(vec3(0.0), v_rotations[g].rgb, color > vec3(0.0));
    }
    if g < frame.count {
        for (var c = 0u; c < 3u; c++) {
            v_colors[3u * g + c] = group_colors[local][c];
        }
    }
    workgroupBarrier();
    weigh_coefficients(local, first);
    workgroupBarrier();
    if !counts {
        if g < frame.count {
            store_zero(g);
        }
        return;
    }
    let by_color = v_rotations[g];
    let by_xy = vec2(v_means[3u * g], v_means[3u * g + 1u]);
    let by_cov = vec3(v_log_scales[3u * g], v_log_scales[3u * g + 1u], v_log_scales[3u * g + 2u]);
    let opacity = projected[3u * g + 1u].y;
    let mean = vec3(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]);
    let scale = exp(vec3(log_scales[3u * g], log_scales[3u * g + 1u], log_scales[3u * g + 2u]));
    let q_raw = rotations[g];
    let q_length = length(q_raw);
    let q = q_raw / q_length;
    let rq = quaternion_matrix(q);
    let axes = mat3x3<f32>(view_rotate(rq[0]), view_rotate(rq[1]), view_rotate(rq[2]));
    let view = view_rotate(mean) + view_translation();
    let e = ewa_project(view, axes, scale);

    let v = ewa_backward(e, view, axes, scale, by_xy, by_cov);
    var v_axes: mat3x3<f32>;
    var v_scale: vec3<f32>;
    for (var c = 0u; c < 3u; c++) {
        v_axes[c] = view_rotate_transposed(v.spread[c]) * scale[c];
        v_scale[c] = dot(axes[c], v.spread[c]) * scale[c];
    }
    let v_mean = view_rotate_transposed(v.view) + direction_backward(local, mean - frame.center);
    let v_q = rotation_backward(q, v_axes);
    v_rotations[g] = (v_q - q * dot(q, v_q)) / q_length;
    for (var c = 0u; c < 3u; c++) {
        v_means[3u * g + c] = v_mean[c];
        v_log_scales[3u * g + c] = v_scale[c];
    }
    v_opacity_logits[g] = by_color.w * opacity * (1.0 - opacity);
}
