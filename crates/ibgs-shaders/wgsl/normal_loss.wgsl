// One workgroup a tile: sum of 0.4 sum_c |Nd - N| + 0.6 (1 - Nd . N), and the number of pixels (method.md section 7).
#import depth_normal
#import reduce

@group(0) @binding(0) var<storage, read> depth: array<f32>;
@group(0) @binding(1) var<storage, read> normal: array<f32>;
@group(0) @binding(2) var<storage, read_write> partials: array<vec2<f32>>;

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
        let nd = depth_normal(at).normal;
        let p = 3u * (at.y * params.size.x + at.x);
        let n = vec3(normal[p], normal[p + 1u], normal[p + 2u]);
        let difference = dot(abs(nd - n), vec3(1.0));
        value = vec4(NORMAL_L1 * difference + NORMAL_DOT * (1.0 - dot(nd, n)), 1.0, 0.0, 0.0);
    }
    let total = reduce(local, value);
    if local == 0u {
        partials[wid.y * groups.x + wid.x] = total.xy;
    }
}
