//! Warped colours in the target's exposure.
#set render
#stage other
// One thread a pixel: each warped colour from its source's exposure to the target's, exp(g_0 - g_s) (y - o_s) + o_0.
#import index
#import seen
#import visible_params

/// Rows of (log gains, -), (offsets, -): the target's, then the sources'.
@group(0) @binding(0) var<storage, read> exposures: array<vec4<f32>>;
/// [V, P, 4]: colour and cosine.
@group(0) @binding(1) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> seen: array<u32>;
@group(0) @binding(3) var<storage, read_write> shifted: array<vec4<f32>>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_workgroup(wid, groups) * 256u + local;
    if p >= params.pixels {
        return;
    }
    for (var m = 0u; m < params.visible; m++) {
        let at = m * params.pixels + p;
        var y = warped[at];
        if is_seen(seen[p], m) {
            let row = 2u * (seen_source(seen[p], m) + 1u);
            let gain = exp(exposures[0].xyz - exposures[row].xyz);
            y = vec4(gain * (y.xyz - exposures[row + 1u].xyz) + exposures[1].xyz, y.w);
        }
        shifted[at] = y;
    }
}
