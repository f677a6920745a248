//! Each tile's list by depth.
#set render
#stage sort
// One workgroup a tile: its list by depth. Equal depths come by emission index, which is the order of the Gaussians; as no two
// entries are equal, the order is the same however the list was filled. Blocks of SORT_BLOCK entries are sorted, in one way for
// processors, which have subgroups of 8 lanes, and in another for other devices. Then blocks are merged, two at a time, between the
// list and the outputs.
#import frame
#import tile_order

@group(0) @binding(0) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(1) var<storage, read> isect_to_gaussian: array<u32>;
/// (depth key, emission index) of each.
@group(0) @binding(2) var<storage, read_write> list: array<vec2<u32>>;
/// Keys of merged blocks, then the Gaussians.
@group(0) @binding(3) var<storage, read_write> sorted_gaussians: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_isects: array<u32>;

fn is_before(a: vec2<u32>, b: vec2<u32>) -> bool {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

fn store_sorted(at: u32, isect: u32) {
    sorted_gaussians[at] = isect_to_gaussian[isect];
    sorted_isects[at] = isect;
}

// An entry of a sorted block: whole lists have their form at once, others keep the keys by which they are merged.
fn store_entry(at: u32, entry: vec2<u32>, is_whole: bool) {
    if is_whole {
        store_sorted(at, entry.y);
    } else {
        sorted_gaussians[at] = entry.x;
        sorted_isects[at] = entry.y;
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
            store_entry(at, entry, false);
        } else {
            list[at] = entry;
        }
    }
}

// Merges runs of `sorted` entries, which lie in the list or the outputs, until one is left, and gives the outputs their form.
fn merge_all(thread: u32, start: u32, count: u32, sorted: u32, in_list: bool) {
    var is_list = in_list;
    for (var run = sorted; run < count; run *= 2u) {
        storageBarrier();
        workgroupBarrier();
        merge(thread, is_list, start, count, run);
        is_list = !is_list;
    }
    storageBarrier();
    workgroupBarrier();
    for (var i = thread; i < count; i += THREADS) {
        store_sorted(start + i, load(is_list, start + i).y);
    }
}

#if NARROW
#import tile_sort_narrow
#else
#import tile_sort_wide
#endif
