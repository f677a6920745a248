// The body of `project` and `project_half`, which read the coefficients of the colours: `splat_color`.
#import index
#import frame
#import gaussian
#import hash
#import tile
#import cover
#import sh

@group(0) @binding(0) var<storage, read> means: array<f32>;
@group(0) @binding(1) var<storage, read> rotations: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> log_scales: array<f32>;
@group(0) @binding(3) var<storage, read> opacity_logits: array<f32>;
/// Three vec4 a Gaussian: (x, y, 1/xx, xy/xx), (xx/det, opacity, depth, radius), (r, g, b, 0); radius 0 = culled.
@group(0) @binding(5) var<storage, read_write> projected: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> tile_counts: array<u32>;

fn load3(i: u32) -> vec3<f32> {
    return vec3(means[3u * i], means[3u * i + 1u], means[3u * i + 2u]);
}

fn cull(i: u32) {
    projected[3u * i] = vec4(0.0);
    projected[3u * i + 1u] = vec4(0.0);
    projected[3u * i + 2u] = vec4(0.0);
    tile_counts[i] = 0u;
}

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
    if hash(i ^ frame.dropout_seed) < frame.dropout_below {
        cull(i);
        return;
    }
    let mean = load3(i);
    let view = view_rotate(mean) + view_translation();
    let q = rotations[i];
    let scale = exp(vec3(log_scales[3u * i], log_scales[3u * i + 1u], log_scales[3u * i + 2u]));
    let opacity = 1.0 / (1.0 + exp(-opacity_logits[i]));
    let broken = not_finite3(view) || not_finite3(scale) || is_nan(opacity_logits[i]) || not_finite(opacity) || not_finite(dot(q, q));
    if broken || dot(q, q) == 0.0 || view.z <= NEAR_DEPTH {
        cull(i);
        return;
    }
    let rq = quaternion_matrix(normalize(q));
    let axes = mat3x3<f32>(view_rotate(rq[0]), view_rotate(rq[1]), view_rotate(rq[2]));
    let e = ewa_project(view, axes, scale);
    let radius = splat_radius(e.cov, e.det);
    if not_finite3(e.cov) || not_finite(e.det) || not_finite(radius) || not_finite3(vec3(e.xy, 0.0)) {
        cull(i);
        return;
    }
    let shape = vec3(1.0 / e.cov.x, e.cov.y / e.cov.x, e.cov.x / e.det);
    let cover = splat_cover(e.xy, radius, shape, opacity);
    var hits = 0u;
    for (var row = cover.rect.y; row < cover.rect.w; row++) {
        let span = tile_span(row, cover);
        hits += span.y - span.x;
    }
    if hits == 0u {
        cull(i);
        return;
    }
    let color = splat_color(i, normalize(mean - frame.center));
    if not_finite3(color) {
        cull(i);
        return;
    }
    projected[3u * i] = vec4(e.xy, shape.xy);
    projected[3u * i + 1u] = vec4(shape.z, opacity, view.z, radius);
    projected[3u * i + 2u] = vec4(max(color, vec3(0.0)), 0.0);
    tile_counts[i] = hits;
}
