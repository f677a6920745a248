//! Each tile's list by depth.
#set render
#stage sort
// One workgroup a tile: its list by depth. Equal depths come by emission index, which is the order of the Gaussians; as no two
// entries are equal, the order is the same however the list was filled. Blocks of SORT_BLOCK entries are sorted in registers, then
// merged, two at a time, between the list and the outputs; where many depths are equal, the entries themselves are merged.
#import frame
#import tile_order
#import sort_block

@group(0) @binding(0) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(1) var<storage, read> isect_to_gaussian: array<u32>;
/// (depth key, emission index) of each.
@group(0) @binding(2) var<storage, read_write> list: array<vec2<u32>>;
/// Keys of merged blocks, then the Gaussians.
@group(0) @binding(3) var<storage, read_write> sorted_gaussians: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_isects: array<u32>;

// An entry of a sorted block, to the outputs: its key where blocks will be merged, its Gaussian where it is the only one.
fn store(word: u32, place: u32, start: u32, count: u32, is_only: bool) {
    if place < count {
        let entry = list[start + (word & NUMBER)];
        let at = start + place_of(place, word, entry, start, count);
        sorted_isects[at] = entry.y;
        if is_only {
            sorted_gaussians[at] = isect_to_gaussian[entry.y];
        } else {
            sorted_gaussians[at] = entry.x;
        }
    }
}

fn load(is_list: bool, at: u32) -> vec2<u32> {
    if is_list {
        return list[at];
    }
    return vec2(sorted_gaussians[at], sorted_isects[at]);
}

// How many of the `count` entries from `start` on come before `entry`, at least `known`.
fn count_before(is_list: bool, start: u32, count: u32, entry: vec2<u32>, known: u32) -> u32 {
    var low = known;
    var high = known + 1u;
    // By steps that double until one is too far.
    while high <= count && is_before(load(is_list, start + high - 1u), entry) {
        let step = 2u * (high - low);
        low = high;
        high += step;
    }
    high = min(high - 1u, count);
    while low < high {
        let middle = (low + high) / 2u;
        if is_before(load(is_list, start + middle), entry) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low;
}

// Runs of `run` entries, two at a time, to the other memory. A thread has entries in a row: the search for one goes on where that for
// the last has ended.
fn merge(thread: u32, is_list: bool, start: u32, count: u32, run: u32) {
    let share = (count + THREADS - 1u) / THREADS;
    var before = 0u;
    for (var i = thread * share; i < min((thread + 1u) * share, count); i++) {
        let own = i & ~(run - 1u);
        let pair = i & ~(2u * run - 1u);
        let other = min(select(pair, pair + run, own == pair), count);
        let entry = load(is_list, start + i);
        before = count_before(is_list, start + other, min(run, count - other), entry, select(before, 0u, i == own));
        let at = start + pair + (i - own) + before;
        if is_list {
            sorted_gaussians[at] = entry.x;
            sorted_isects[at] = entry.y;
        } else {
            list[at] = entry;
        }
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
    var is_list = false;
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
            is_list = true;
            break;
        }
    }
    if count <= sorted {
        return;
    }
    for (var run = sorted; run < count; run *= 2u) {
        storageBarrier();
        workgroupBarrier();
        merge(thread, is_list, start, count, run);
        is_list = !is_list;
    }
    storageBarrier();
    workgroupBarrier();
    for (var i = thread; i < count; i += THREADS) {
        let isect = load(is_list, start + i).y;
        sorted_gaussians[start + i] = isect_to_gaussian[isect];
        sorted_isects[start + i] = isect;
    }
}
