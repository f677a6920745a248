// One thread a pixel: corrected = A base + t.
#import index

var<immediate> pixels: u32;

// Three rows of [A | t].
@group(0) @binding(0) var<storage, read> affine: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> base: array<f32>;
@group(0) @binding(2) var<storage, read_write> corrected: array<f32>;

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
    let color = vec4(base[3u * p], base[3u * p + 1u], base[3u * p + 2u], 1.0);
    corrected[3u * p] = dot(affine[0], color);
    corrected[3u * p + 1u] = dot(affine[1], color);
    corrected[3u * p + 2u] = dot(affine[2], color);
}
