//! Densification statistics.
#set train
#stage other
// One thread a Gaussian: adds one view to the densification statistics (method.md section 7).
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
    /// Padding.
    pad: u32,
}

var<immediate> params: ObserveParams;

@group(0) @binding(0) var<storage, read> v_screen: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> projected: array<vec4<f32>>;
/// (sum of gradient norms, sum of absolute-gradient norms, views that saw it, largest radius in pixels), or
/// (largest absolute-gradient norm, 0, views that saw it, largest radius in units of the image's longer side).
@group(0) @binding(2) var<storage, read_write> statistics: array<vec4<f32>>;

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
    if radius > 0.0 && v_screen[i].w >= 0.0 && params.largest == 1u {
        let size = vec2<f32>(params.size);
        let v = v_screen[i];
        let s = statistics[i];
        statistics[i] = vec4(
            max(s.x, length(v.zw * size)),
            s.y,
            s.z + 1.0,
            max(s.w, radius / max(size.x, size.y)),
        );
    } else if radius > 0.0 && v_screen[i].w >= 0.0 {
        let half_size = 0.5 * vec2<f32>(params.size);
        let nearness = min(projected[3u * i + 1u].z / max(params.near_depth, 1e-20), 1.0);
        let v = v_screen[i] * nearness * nearness;
        let s = statistics[i];
        statistics[i] = vec4(
            s.x + length(v.xy * half_size),
            s.y + length(v.zw * half_size),
            s.z + 1.0,
            max(s.w, radius),
        );
    }
}
