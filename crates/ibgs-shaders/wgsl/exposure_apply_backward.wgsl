// One thread a pixel: v_base += A^T v_corrected. The map itself is a constant (method.md section 8).
#import index

var<immediate> pixels: u32;

// Three rows of [A | t].
@group(0) @binding(0) var<storage, read> affine: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> v_corrected: array<f32>;
@group(0) @binding(2) var<storage, read_write> v_base: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_workgroup(wid, groups) * 256u + local;
    if p >= pixels {
        return;
    }
    let v = v_corrected[3u * p] * affine[0].xyz
        + v_corrected[3u * p + 1u] * affine[1].xyz
        + v_corrected[3u * p + 2u] * affine[2].xyz;
    v_base[3u * p] += v.x;
    v_base[3u * p + 1u] += v.y;
    v_base[3u * p + 2u] += v.z;
}
