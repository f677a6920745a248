//! Intersections into the lists of their tiles.
#set render
#stage sort
// One thread an intersection: into the list of its tile, with the bits of its Gaussian's depth as the key of the sort. Depths are
// positive, so that their bits are in the same order.
#import index
#import frame

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> count: array<u32>;
@group(0) @binding(2) var<storage, read> isect_tiles: array<u32>;
@group(0) @binding(3) var<storage, read> isect_places: array<u32>;
@group(0) @binding(4) var<storage, read> isect_to_gaussian: array<u32>;
@group(0) @binding(5) var<storage, read> tile_ranges: array<u32>;
/// (depth key, emission index) of each.
@group(0) @binding(6) var<storage, read_write> list: array<vec2<u32>>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let k = linear_workgroup(wid, groups) * 256u + local;
    if k >= min(count[0], frame.capacity) {
        return;
    }
    let at = tile_ranges[2u * isect_tiles[k]] + isect_places[k];
    list[at] = vec2(bitcast<u32>(projected[3u * isect_to_gaussian[k] + 1u].z), k);
}
