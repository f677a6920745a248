//! Gradient by the warped colours in the sources' exposures.
#set train
#stage other
// One thread a pixel: v_y = exp(g_0 - g_s) v. The exposures are constants.
#import index
#import seen
#import visible_params

@group(0) @binding(0) var<storage, read> exposures: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> seen: array<u32>;
@group(0) @binding(2) var<storage, read> v_shifted: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> v_warped: array<vec4<f32>>;

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
        var v = v_shifted[at];
        if is_seen(seen[p], m) {
            let row = 2u * (seen_source(seen[p], m) + 1u);
            v = vec4(exp(exposures[0].xyz - exposures[row].xyz) * v.xyz, v.w);
        }
        v_warped[at] = v;
    }
}
