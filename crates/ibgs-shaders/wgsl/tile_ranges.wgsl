// One thread an intersection in tile order: where each tile's list starts and ends, and the Gaussian of each entry.
#import index
#import frame

@group(0) @binding(0) var<storage, read> sorted_tiles: array<u32>;
@group(0) @binding(1) var<storage, read> sorted_isects: array<u32>;
@group(0) @binding(2) var<storage, read> isect_to_gaussian: array<u32>;
@group(0) @binding(3) var<storage, read> count: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_gaussians: array<u32>;
// (start, end) of each tile; zeroed before.
@group(0) @binding(5) var<storage, read_write> tile_ranges: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let k = linear_workgroup(wid, groups) * 256u + local;
    let n = min(count[0], frame.capacity);
    if k >= n {
        return;
    }
    sorted_gaussians[k] = isect_to_gaussian[sorted_isects[k]];
    let tile = sorted_tiles[k];
    let tiles = frame_tiles();
    if tile >= tiles.x * tiles.y {
        return;
    }
    if k == 0u || sorted_tiles[k - 1u] != tile {
        tile_ranges[2u * tile] = k;
    }
    if k + 1u == n || sorted_tiles[k + 1u] != tile {
        tile_ranges[2u * tile + 1u] = k + 1u;
    }
}
