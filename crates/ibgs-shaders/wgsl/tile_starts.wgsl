// One workgroup: where each tile's list starts and ends. Behind the last tile stands the list of the tile that does not exist. The
// lengths are zeros again afterwards, for the next pass.
#import frame
#import scan_block

@group(0) @binding(0) var<storage, read_write> list_lengths: array<u32>;
// (start, end) of each tile.
@group(0) @binding(1) var<storage, read_write> tile_ranges: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) local: u32) {
    let tiles = frame_tiles();
    let lists = tiles.x * tiles.y + 1u;
    // Each thread has lists in a row.
    let own = (lists + 255u) / 256u;
    let first = local * own;
    let behind = min(first + own, lists);
    var sum = 0u;
    for (var list = first; list < behind; list++) {
        sum += list_lengths[list];
    }
    var start = scan_block(local, sum).exclusive;
    for (var list = first; list < behind; list++) {
        tile_ranges[2u * list] = start;
        start += list_lengths[list];
        tile_ranges[2u * list + 1u] = start;
        list_lengths[list] = 0u;
    }
}
