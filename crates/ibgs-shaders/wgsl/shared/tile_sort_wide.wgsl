// A block of a tile's list sorted by words (sort_block.wgsl), by a thread for eight entries in a row. Where many depths are equal, the
// entries themselves are merged.
#import sort_block

// The entry of a word at a place of its block, to the outputs.
fn store(word: u32, place: u32, start: u32, count: u32, is_whole: bool) {
    if place < count {
        let entry = list[start + (word & NUMBER)];
        store_entry(start + place_of(place, word, entry, start, count), entry, is_whole);
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    #if SUBGROUPS
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_invocation_id) lane: u32,
    #else
    @builtin(local_invocation_index) thread: u32,
    #endif
) {
    #if SUBGROUPS
    let thread = subgroup * LANES + lane;
    #endif
    let tile = tile_of(wid);
    let start = tile_ranges[2u * tile];
    let count = tile_ranges[2u * tile + 1u] - start;
    if thread == 0u {
        atomicStore(&differing, 0u);
        atomicStore(&tied, 0u);
    }
    workgroupBarrier();
    // Runs that are in order, and where they lie.
    var sorted = SORT_BLOCK;
    var in_list = false;
    for (var first = 0u; first < count; first += SORT_BLOCK) {
        let size = min(SORT_BLOCK, count - first);
        let own = sorted_words(thread, start + first, size);
        #repeat k 4
        store(own.near[$k], OWN * thread + $ku, start + first, size, count <= SORT_BLOCK);
        store(own.far[$k], OWN * thread + 4u + $ku, start + first, size, count <= SORT_BLOCK);
        #end
        workgroupBarrier();
        if thread == 0u {
            tied_now = atomicLoad(&tied);
        }
        if workgroupUniformLoad(&tied_now) == 1u {
            // The list is as it was.
            sorted = 1u;
            in_list = true;
            break;
        }
    }
    if count > sorted {
        merge_all(thread, start, count, sorted, in_list);
    }
}
