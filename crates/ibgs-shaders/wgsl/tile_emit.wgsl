//! Tile of each intersection, its place in the tile's list, its Gaussian.
#set render
#stage sort
// One thread an intersection, by Gaussians and by rows of tiles within a Gaussian: its tile, its place among that tile's
// intersections, and its Gaussian. The place is by chance; `tile_sort` brings order. The Gaussian is found in the scanned offsets, so
// that a thread takes equally long for a Gaussian that covers the whole image.
#import index
#import frame
#import tile
#import cover

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> offsets: array<u32>;
@group(0) @binding(2) var<storage, read> count: array<u32>;
@group(0) @binding(3) var<storage, read_write> isect_tiles: array<u32>;
@group(0) @binding(4) var<storage, read_write> isect_places: array<u32>;
@group(0) @binding(5) var<storage, read_write> isect_to_gaussian: array<u32>;
/// Zeros before: entries of each tile's list.
@group(0) @binding(6) var<storage, read_write> list_lengths: array<atomic<u32>>;
@group(0) @binding(7) var<storage, read_write> tile_counts: array<atomic<u32>>;

// The last Gaussian whose intersections start at `k` or before: those without any share their offset with the next.
fn gaussian_of(k: u32) -> u32 {
    var first = 0u;
    var behind = frame.count;
    while behind - first > 1u {
        let middle = (first + behind) / 2u;
        if offsets[middle] <= k {
            first = middle;
        } else {
            behind = middle;
        }
    }
    return first;
}

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
    let g = gaussian_of(k);
    let a = projected[3u * g];
    let b = projected[3u * g + 1u];
    let tiles = frame_tiles();
    let cover = splat_cover(a.xy, b.w, vec3(a.zw, b.x), b.y);
    // If rounding finds fewer tiles here than were counted, the rest go to a tile that does not exist, and count no more.
    var tile = tiles.x * tiles.y;
    var before = k - offsets[g];
    for (var row = cover.rect.y; row < cover.rect.w; row++) {
        let span = tile_span(row, cover);
        if before < span.y - span.x {
            tile = row * tiles.x + span.x + before;
            break;
        }
        before -= span.y - span.x;
    }
    if tile == tiles.x * tiles.y {
        atomicMin(&tile_counts[g], k - offsets[g]);
    }
    isect_tiles[k] = tile;
    isect_places[k] = atomicAdd(&list_lengths[tile], 1u);
    isect_to_gaussian[k] = g;
}
