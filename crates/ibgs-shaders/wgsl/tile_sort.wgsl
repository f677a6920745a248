//! Each tile's list by depth.
#set render
#stage sort
// One workgroup a tile: its list by depth. Equal depths come by emission index, which is the order of the Gaussians; as no two
// entries are equal, the order is the same however the list was filled. Blocks of SORT_BLOCK entries are sorted in registers
// (bitonic: every step compares and swaps pairs, the smaller entry to the front), four in a row a thread, or one in short lists.
// Threads compare through workgroup memory; SUBGROUPS: those of a subgroup without it. Then blocks are merged, two at a time, between
// the list and the outputs.
#import frame
#import tile_order

@group(0) @binding(0) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(1) var<storage, read> isect_to_gaussian: array<u32>;
/// (depth key, emission index) of each.
@group(0) @binding(2) var<storage, read_write> list: array<vec2<u32>>;
/// Keys of merged blocks, then the Gaussians.
@group(0) @binding(3) var<storage, read_write> sorted_gaussians: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_isects: array<u32>;

const THREADS: u32 = SORT_BLOCK / 4u;
const IN_THREAD = vec4(0u, 1u, 2u, 3u);

// Four entries.
struct Four {
    keys: vec4<u32>,
    isects: vec4<u32>,
}

var<workgroup> all_keys: array<vec4<u32>, THREADS>;
var<workgroup> all_isects: array<vec4<u32>, THREADS>;

fn is_before(a: vec2<u32>, b: vec2<u32>) -> bool {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

// The entries of the thread whose number differs by the bits of `mask`. Every thread calls it, in uniform control flow.
fn entries_of(own: Four, thread: u32, mask: u32) -> Four {
    #if SUBGROUPS
    if mask < LANES {
        return Four(subgroupShuffleXor(own.keys, mask), subgroupShuffleXor(own.isects, mask));
    }
    #endif
    workgroupBarrier();
    all_keys[thread] = own.keys;
    all_isects[thread] = own.isects;
    workgroupBarrier();
    return Four(all_keys[thread ^ mask], all_isects[thread ^ mask]);
}

// Puts in order each entry with the one whose place differs by the bits of `mask`.
fn put_in_order(own: Four, thread: u32, mask: u32) -> Four {
    var other = own;
    if mask >= 4u {
        other = entries_of(own, thread, mask / 4u);
    }
    if (mask & 1u) != 0u {
        other = Four(other.keys.yxwz, other.isects.yxwz);
    }
    if (mask & 2u) != 0u {
        other = Four(other.keys.zwxy, other.isects.zwxy);
    }
    let place = 4u * thread + IN_THREAD;
    let is_first = place < (place ^ vec4(mask));
    let precedes = (other.keys < own.keys) | ((other.keys == own.keys) & (other.isects < own.isects));
    let swap = precedes == is_first;
    return Four(select(own.keys, other.keys, swap), select(own.isects, other.isects, swap));
}

// Sorts `count` entries from `start` on. Behind the last one lies what is larger than any, and stays there.
fn sort_block(thread: u32, start: u32, count: u32) -> Four {
    var own = Four(vec4(0xffffffffu), vec4(0xffffffffu));
    #repeat k 4
    if 4u * thread + $ku < count {
        let entry = list[start + 4u * thread + $ku];
        own.keys[$k] = entry.x;
        own.isects[$k] = entry.y;
    }
    #end
    // Runs of half the size are in order. The first step compares the one run with the other backwards.
    for (var half = 1u; half < count; half *= 2u) {
        own = put_in_order(own, thread, 2u * half - 1u);
        for (var step = half / 2u; step > 0u; step /= 2u) {
            own = put_in_order(own, thread, step);
        }
    }
    return own;
}

// The entry of the thread whose number differs by the bits of `mask`, as `entries_of`.
fn entry_of(own: vec2<u32>, thread: u32, mask: u32) -> vec2<u32> {
    #if SUBGROUPS
    if mask < LANES {
        return subgroupShuffleXor(own, mask);
    }
    #endif
    workgroupBarrier();
    all_keys[thread] = vec4(own, 0u, 0u);
    workgroupBarrier();
    return all_keys[thread ^ mask].xy;
}

fn put_one_in_order(own: vec2<u32>, thread: u32, mask: u32) -> vec2<u32> {
    let other = entry_of(own, thread, mask);
    let is_first = thread < (thread ^ mask);
    return select(own, other, is_before(other, own) == is_first);
}

// As `sort_block`, at most THREADS entries.
fn sort_few(thread: u32, start: u32, count: u32) -> vec2<u32> {
    var own = vec2(0xffffffffu);
    if thread < count {
        own = list[start + thread];
    }
    for (var half = 1u; half < count; half *= 2u) {
        own = put_one_in_order(own, thread, 2u * half - 1u);
        for (var step = half / 2u; step > 0u; step /= 2u) {
            own = put_one_in_order(own, thread, step);
        }
    }
    return own;
}

fn store_sorted(at: u32, isect: u32) {
    sorted_gaussians[at] = isect_to_gaussian[isect];
    sorted_isects[at] = isect;
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
    if count <= THREADS {
        let own = sort_few(thread, start, count);
        if thread < count {
            store_sorted(start + thread, own.y);
        }
        return;
    }
    if count <= SORT_BLOCK {
        let own = sort_block(thread, start, count);
        #repeat k 4
        if 4u * thread + $ku < count {
            store_sorted(start + 4u * thread + $ku, own.isects[$k]);
        }
        #end
        return;
    }
    for (var first = 0u; first < count; first += SORT_BLOCK) {
        let size = min(SORT_BLOCK, count - first);
        let own = sort_block(thread, start + first, size);
        #repeat k 4
        if 4u * thread + $ku < size {
            list[start + first + 4u * thread + $ku] = vec2(own.keys[$k], own.isects[$k]);
        }
        #end
    }
    var is_list = true;
    for (var run = SORT_BLOCK; run < count; run *= 2u) {
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
