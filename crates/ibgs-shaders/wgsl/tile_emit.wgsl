// One thread a Gaussian in depth order: writes its (tile, Gaussian) intersections from the scanned offset on.
#import index
#import frame
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> depth_order: array<u32>;
@group(0) @binding(2) var<storage, read> offsets: array<u32>;
@group(0) @binding(3) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> isect_tiles: array<u32>;
@group(0) @binding(5) var<storage, read_write> isect_to_gaussian: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let rank = linear_workgroup(wid, groups) * 256u + local;
    if rank >= frame.count {
        return;
    }
    let g = depth_order[rank];
    // Never more than was counted, never past the end; what is left over is padded with an absent tile.
    let start = offsets[rank];
    let end = min(start + tile_counts[g], frame.capacity);
    if start >= end {
        return;
    }
    let a = projected[3u * g];
    let b = projected[3u * g + 1u];
    let shape = vec3(a.zw, b.x);
    let tiles = frame_tiles();
    let rect = tile_rect(a.xy, b.w, tiles);
    var at = start;
    for (var y = rect.y; y < rect.w; y++) {
        for (var x = rect.x; x < rect.z; x++) {
            if at < end && tile_hit(vec2(x, y), a.xy, shape, b.y) {
                isect_tiles[at] = y * tiles.x + x;
                isect_to_gaussian[at] = g;
                at++;
            }
        }
    }
    for (; at < end; at++) {
        isect_tiles[at] = tiles.x * tiles.y;
        isect_to_gaussian[at] = g;
    }
}
