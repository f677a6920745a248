//! Depth normals against the normal map, forward.
#set train
#stage normal loss
// One workgroup a tile: sum of 0.4 sum_c |Nd - N| + 0.6 (1 - Nd . N), and the number of pixels (method.md section 7).
// Pixels that are masked in the photo add nothing to the sum.
#import depth_normal
#import photo
#import reduce

@group(0) @binding(0) var<storage, read> depth: array<f32>;
@group(0) @binding(1) var<storage, read> normal: array<f32>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
@group(0) @binding(3) var<storage, read_write> partials: array<vec2<f32>>;

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_id) lid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = wid.xy * TILE + lid.xy;
    var value = vec4(0.0);
    if all(at < params.size) {
        let p = at.y * params.size.x + at.x;
        value.y = 1.0;
        if photo_valid(photo[p]) {
            let nd = depth_normal(at).normal;
            let n = vec3(normal[3u * p], normal[3u * p + 1u], normal[3u * p + 2u]);
            let difference = dot(abs(nd - n), vec3(1.0));
            value.x = NORMAL_L1 * difference + NORMAL_DOT * (1.0 - dot(nd, n));
        }
    }
    let total = reduce(local, value);
    if local == 0u {
        partials[wid.y * groups.x + wid.x] = total.xy;
    }
}
