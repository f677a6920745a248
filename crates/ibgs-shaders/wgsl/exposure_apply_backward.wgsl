// One thread a pixel: v_base += A_0^T v_corrected + sum over its sources (A_0 - A_s)^T v_shifted. The maps themselves are
// constants (method.md section 8).
#import index
#import seen
#import exposure_apply_params

// Three rows of [A | t] a map: the output's, then the sources'.
@group(0) @binding(0) var<storage, read> affine: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> seen: array<u32>;
@group(0) @binding(2) var<storage, read> v_corrected: array<f32>;
// [V, P, 4].
@group(0) @binding(3) var<storage, read> v_shifted: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> v_base: array<f32>;

fn transposed(row: u32, v: vec3<f32>) -> vec3<f32> {
    return v.x * affine[row].xyz + v.y * affine[row + 1u].xyz + v.z * affine[row + 2u].xyz;
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
    let packed = seen[p];
    let by_base = vec3(v_corrected[3u * p], v_corrected[3u * p + 1u], v_corrected[3u * p + 2u]);
    var v = select(transposed(0u, by_base), by_base, stays(packed));
    for (var m = 0u; m < params.slots; m++) {
        if slot_filled(packed, m) {
            let by = v_shifted[m * params.pixels + p].xyz;
            v += transposed(0u, by) - transposed(3u * (slot_source(packed, m) + 1u), by);
        }
    }
    for (var c = 0u; c < 3u; c++) {
        v_base[3u * p + c] += v[c];
    }
}
