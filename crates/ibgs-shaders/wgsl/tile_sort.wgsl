// One workgroup a tile: its list by depth. Equal depths come by emission index, which is the order of the Gaussians; as no two
// entries are equal, the order is the same however the list was filled. Blocks of SORT_BLOCK entries are sorted in workgroup memory
// (bitonic: every step compares and swaps pairs, the smaller entry to the front), then merged, two at a time, between the list and
// the scratch. In the end the keys make room for the Gaussians.
#import frame

@group(0) @binding(0) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(1) var<storage, read> isect_to_gaussian: array<u32>;
@group(0) @binding(2) var<storage, read_write> list_keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> list_isects: array<u32>;
@group(0) @binding(4) var<storage, read_write> scratch_keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> scratch_isects: array<u32>;

// (depth key, emission index) of each.
var<workgroup> entries: array<vec2<u32>, SORT_BLOCK>;

fn is_before(a: vec2<u32>, b: vec2<u32>) -> bool {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

fn load(is_scratch: bool, at: u32) -> vec2<u32> {
    if is_scratch {
        return vec2(scratch_keys[at], scratch_isects[at]);
    }
    return vec2(list_keys[at], list_isects[at]);
}

fn store(is_scratch: bool, at: u32, entry: vec2<u32>) {
    if is_scratch {
        scratch_keys[at] = entry.x;
        scratch_isects[at] = entry.y;
    } else {
        list_keys[at] = entry.x;
        list_isects[at] = entry.y;
    }
}

// Behind the last entry lies what is larger than any: a pair that reaches there is in order.
fn put_in_order(first: u32, second: u32, count: u32) {
    if second < count && is_before(entries[second], entries[first]) {
        let larger = entries[first];
        entries[first] = entries[second];
        entries[second] = larger;
    }
}

fn sort_block(local: u32, start: u32, count: u32) {
    for (var i = local; i < count; i += 256u) {
        entries[i] = load(false, start + i);
    }
    workgroupBarrier();
    // Runs of half the size are in order. The first step compares the one run with the other backwards.
    for (var half = 1u; half < count; half *= 2u) {
        for (var pair = local; 2u * pair < count + half; pair += 256u) {
            let at = pair & (half - 1u);
            let run = 2u * (pair - at);
            put_in_order(run + at, run + 2u * half - 1u - at, count);
        }
        workgroupBarrier();
        for (var step = half / 2u; step > 0u; step /= 2u) {
            for (var pair = local; 2u * pair < count; pair += 256u) {
                let first = 2u * pair - (pair & (step - 1u));
                put_in_order(first, first + step, count);
            }
            workgroupBarrier();
        }
    }
    for (var i = local; i < count; i += 256u) {
        store(false, start + i, entries[i]);
    }
    workgroupBarrier();
}

// How many of the `count` entries from `start` on come before `entry`.
fn count_before(is_scratch: bool, start: u32, count: u32, entry: vec2<u32>) -> u32 {
    var low = 0u;
    var high = count;
    while low < high {
        let middle = (low + high) / 2u;
        if is_before(load(is_scratch, start + middle), entry) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low;
}

// Runs of `run` entries, two at a time, to the other memory.
fn merge(local: u32, is_scratch: bool, start: u32, count: u32, run: u32) {
    for (var i = local; i < count; i += 256u) {
        let own = i & ~(run - 1u);
        let pair = i & ~(2u * run - 1u);
        let other = min(select(pair, pair + run, own == pair), count);
        let entry = load(is_scratch, start + i);
        let before = count_before(is_scratch, start + other, min(run, count - other), entry);
        store(!is_scratch, start + pair + (i - own) + before, entry);
    }
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let tile = wid.y * frame_tiles().x + wid.x;
    let start = tile_ranges[2u * tile];
    let count = tile_ranges[2u * tile + 1u] - start;
    for (var first = 0u; first < count; first += SORT_BLOCK) {
        sort_block(local, start + first, min(SORT_BLOCK, count - first));
    }
    var is_scratch = false;
    for (var run = SORT_BLOCK; run < count; run *= 2u) {
        storageBarrier();
        workgroupBarrier();
        merge(local, is_scratch, start, count, run);
        is_scratch = !is_scratch;
    }
    storageBarrier();
    workgroupBarrier();
    for (var i = local; i < count; i += 256u) {
        let isect = load(is_scratch, start + i).y;
        list_keys[start + i] = isect_to_gaussian[isect];
        list_isects[start + i] = isect;
    }
}
