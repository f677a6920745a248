// One thread an intersection, in depth order and by rows of tiles within a Gaussian: its tile and its Gaussian. The Gaussian is
// found in the scanned offsets, so that a thread takes equally long for a Gaussian that covers the whole image.
#import index
#import frame
#import tile
#import cover

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> depth_order: array<u32>;
@group(0) @binding(2) var<storage, read> offsets: array<u32>;
@group(0) @binding(3) var<storage, read> count: array<u32>;
@group(0) @binding(4) var<storage, read_write> isect_tiles: array<u32>;
@group(0) @binding(5) var<storage, read_write> isect_to_gaussian: array<u32>;

// The last rank whose intersections start at `k` or before: those without any share their offset with the next.
fn rank_of(k: u32) -> u32 {
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
    let rank = rank_of(k);
    let g = depth_order[rank];
    let a = projected[3u * g];
    let b = projected[3u * g + 1u];
    let tiles = frame_tiles();
    let cover = splat_cover(a.xy, b.w, vec3(a.zw, b.x), b.y);
    // If rounding finds fewer tiles here than were counted, the rest go to a tile that does not exist.
    var tile = tiles.x * tiles.y;
    var before = k - offsets[rank];
    for (var row = cover.rect.y; row < cover.rect.w; row++) {
        let span = tile_span(row, cover);
        if before < span.y - span.x {
            tile = row * tiles.x + span.x + before;
            break;
        }
        before -= span.y - span.x;
    }
    isect_tiles[k] = tile;
    isect_to_gaussian[k] = g;
}
