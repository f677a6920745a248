//! Depth normals, for pictures.
#set train
#stage other
// One thread a pixel: the depth normals as a map, [P, 3].
#import depth_normal

@group(0) @binding(0) var<storage, read> depth: array<f32>;
@group(0) @binding(1) var<storage, read_write> depth_normals: array<f32>;

@compute @workgroup_size(TILE, TILE)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let normal = depth_normal(id.xy).normal;
    let p = 3u * (id.y * params.size.x + id.x);
    depth_normals[p] = normal.x;
    depth_normals[p + 1u] = normal.y;
    depth_normals[p + 2u] = normal.z;
}
