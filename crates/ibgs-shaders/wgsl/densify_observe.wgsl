//! Densification statistics.
#set train
#stage project backward
// One thread a Gaussian: adds one view to the densification statistics (method.md section 7), of the sums by screen position that
// sum_rows.wgsl has left in v_means (x, y, |x|) and v_opacity_logits (|y|).
#import index

/// Densification statistics.
struct ObserveParams {
    /// Image size in pixels.
    size: vec2<u32>,
    /// Number of Gaussians.
    count: u32,
    /// Gradients of Gaussians nearer than this view depth count by the square of their depth over it.
    near_depth: f32,
    /// 1: the largest norm over the views, in units of the image, in place of sums in units of half of it.
    largest: u32,
    /// Length of the intersection buffers.
    capacity: u32,
}

var<immediate> params: ObserveParams;

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(2) var<storage, read> total: array<u32>;
@group(0) @binding(3) var<storage, read> v_means: array<f32>;
@group(0) @binding(4) var<storage, read> v_opacity_logits: array<f32>;
/// (sum of gradient norms, sum of absolute-gradient norms, views that saw it, largest radius in pixels), or
/// (largest absolute-gradient norm, 0, views that saw it, largest radius in units of the image's longer side).
@group(0) @binding(5) var<storage, read_write> statistics: array<vec4<f32>>;

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
    let radius = projected[3u * i + 1u].w;
    // Without room there is not a row for every intersection: the view does not count.
    if radius <= 0.0 || total[0] > params.capacity {
        return;
    }
    // One that reaches no tile has no sums.
    var v = vec4(0.0);
    if tile_counts[i] != 0u {
        v = vec4(v_means[3u * i], v_means[3u * i + 1u], v_means[3u * i + 2u], v_opacity_logits[i]);
    }
    let s = statistics[i];
    let size = vec2<f32>(params.size);
    if params.largest == 1u {
        statistics[i] = vec4(
            max(s.x, length(v.zw * size)),
            s.y,
            s.z + 1.0,
            max(s.w, radius / max(size.x, size.y)),
        );
        return;
    }
    let nearness = min(projected[3u * i + 1u].z / max(params.near_depth, 1e-20), 1.0);
    v *= nearness * nearness;
    statistics[i] = vec4(
        s.x + length(v.xy * 0.5 * size),
        s.y + length(v.zw * 0.5 * size),
        s.z + 1.0,
        max(s.w, radius),
    );
}
