// One thread a pixel: the base colour in the output's exposure, out = A_0 base + t_0, and each warped colour with the change of
// exposure from its source to the output, y + out - (A_s base + t_s).
#import index
#import seen
#import exposure_apply_params

// Three rows of [A | t] a map: the output's, then the sources'.
@group(0) @binding(0) var<storage, read> affine: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> base: array<f32>;
// [V, P, 4]: colour and cosine.
@group(0) @binding(2) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> seen: array<u32>;
@group(0) @binding(4) var<storage, read_write> corrected: array<f32>;
// As warped.
@group(0) @binding(5) var<storage, read_write> shifted: array<vec4<f32>>;

fn exposed(row: u32, color: vec4<f32>) -> vec3<f32> {
    return vec3(dot(affine[row], color), dot(affine[row + 1u], color), dot(affine[row + 2u], color));
}

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
    let color = vec4(base[3u * p], base[3u * p + 1u], base[3u * p + 2u], 1.0);
    let packed = seen[p];
    let out = select(exposed(0u, color), color.xyz, stays(packed));
    for (var c = 0u; c < 3u; c++) {
        corrected[3u * p + c] = out[c];
    }
    for (var m = 0u; m < params.slots; m++) {
        let at = m * params.pixels + p;
        var y = warped[at];
        if slot_filled(packed, m) {
            y += vec4(out - exposed(3u * (slot_source(packed, m) + 1u), color), 0.0);
        }
        shifted[at] = y;
    }
}
