// An entry's place in its block is the number of those before it. A subgroup counts for 64 entries of a block, a lane for eight, and
// the lanes hand on what they read. lavapipe ends a thread's loops after 65,535 steps in all, so few threads could not sort a long list:
// those of half the workgroup have every second block.

const THREADS: u32 = SORT_BLOCK / 8u;
const BLOCK: u32 = SORT_BLOCK / 2u;
// Subgroups of a block.
const HALF: u32 = BLOCK / (8u * LANES);

fn entry_at(start: u32, count: u32, i: u32) -> vec2<u32> {
    return select(vec2(0xffffffffu), list[start + min(i, count - 1u)], i < count);
}

// Sorts `count` entries of the list from `start` on, at most BLOCK, to the outputs: as a whole list, or as keys and isects that are
// merged.
fn sort_block(subgroup: u32, lane: u32, start: u32, count: u32, is_whole: bool) {
    let first = 8u * LANES * subgroup + lane;
    #repeat k 8
    let own_$k = entry_at(start, count, first + $ku * LANES);
    var before_$k = 0u;
    #end
    let end = select(0u, count, 8u * LANES * subgroup < count);
    for (var i = lane; i < end + lane; i += LANES) {
        let read = entry_at(start, count, i);
        #repeat r 8
        {
            let other = subgroupShuffle(read, (lane + $ru) % LANES);
            #repeat k 8
            before_$k += select(0u, 1u, is_before(other, own_$k));
            #end
        }
        #end
    }
    #repeat k 8
    if first + $ku * LANES < count {
        store_entry(start + before_$k, own_$k, is_whole);
    }
    #end
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let thread = LANES * subgroup + lane;
    let tile = tile_of(wid);
    let start = tile_ranges[2u * tile];
    let count = tile_ranges[2u * tile + 1u] - start;
    for (var first = BLOCK * (subgroup / HALF); first < count; first += 2u * BLOCK) {
        sort_block(subgroup % HALF, lane, start + first, min(BLOCK, count - first), count <= BLOCK);
    }
    if count > BLOCK {
        merge_all(thread, start, count, BLOCK, false);
    }
}
