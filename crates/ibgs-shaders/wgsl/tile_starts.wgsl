//! Start and end of each tile's list.
#set render
#stage sort
// One workgroup: where each tile's list starts and ends, and in which order workgroups take the tiles: long lists first, sorted by
// eighths of a power of two. Which of two lists as long comes first is by chance, and nothing depends on it. Behind the last tile
// stands the list of the tile that does not exist. The lengths are zeros again afterwards, for the next pass.
#import frame
#import scan_block

@group(0) @binding(0) var<storage, read_write> list_lengths: array<u32>;
/// (start, end) of each tile, then the tiles in their order.
@group(0) @binding(1) var<storage, read_write> tile_ranges: array<u32>;

// Lists of a thread in a row.
const OWN: u32 = 4u;
const CHUNK: u32 = OWN * 256u;

var<workgroup> lengths: array<u32, CHUNK>;
var<workgroup> ends: array<u32, CHUNK>;
// Tiles by the length of their list, then where those of a length start.
var<workgroup> buckets: array<atomic<u32>, 256>;

// Longer lists have smaller ones.
fn bucket(length: u32) -> u32 {
    let at_least = max(length, 8u);
    let octave = 31u - countLeadingZeros(at_least);
    return 255u - 8u * octave - ((at_least >> (octave - 3u)) & 7u);
}

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) local: u32) {
    let tiles = frame_tiles();
    let lists = tiles.x * tiles.y + 1u;
    atomicStore(&buckets[local], 0u);
    var start = 0u;
    for (var first = 0u; first < lists; first += CHUNK) {
        workgroupBarrier();
        for (var k = local; k < CHUNK; k += 256u) {
            var length = 0u;
            if first + k < lists {
                length = list_lengths[first + k];
                list_lengths[first + k] = 0u;
            }
            lengths[k] = length;
            if first + k + 1u < lists {
                atomicAdd(&buckets[bucket(length)], 1u);
            }
        }
        workgroupBarrier();
        var sum = 0u;
        for (var k = OWN * local; k < OWN * (local + 1u); k++) {
            sum += lengths[k];
        }
        let scan = scan_block(local, sum);
        var end = start + scan.exclusive;
        for (var k = OWN * local; k < OWN * (local + 1u); k++) {
            end += lengths[k];
            ends[k] = end;
        }
        start += scan.total;
        workgroupBarrier();
        for (var k = local; k < min(CHUNK, lists - first); k += 256u) {
            tile_ranges[2u * (first + k)] = ends[k] - lengths[k];
            tile_ranges[2u * (first + k) + 1u] = ends[k];
        }
    }
    workgroupBarrier();
    let place = scan_block(local, atomicLoad(&buckets[local])).exclusive;
    atomicStore(&buckets[local], place);
    workgroupBarrier();
    // Each thread reads what it has written.
    for (var tile = local; tile + 1u < lists; tile += 256u) {
        let length = tile_ranges[2u * tile + 1u] - tile_ranges[2u * tile];
        tile_ranges[2u * lists + atomicAdd(&buckets[bucket(length)], 1u)] = tile;
    }
}
