// Sorts a block of a tile's list in registers, eight entries in a row a thread, as words: the leading bits of the depth that differ
// within the block, and the entry's number. A bitonic sort's every step compares and swaps pairs, the smaller word to the front.
// Threads exchange words through workgroup memory; SUBGROUPS: those of a subgroup without it. Entries whose words have the same depth
// then find their places by comparing themselves. The kernel declares `list`.

const OWN: u32 = 8u;
const THREADS: u32 = SORT_BLOCK / OWN;
// A word has the number of its entry within the block in its last bits.
const NUMBER: u32 = SORT_BLOCK - 1u;
// Bits of a depth in a word.
const DEPTH_BITS: u32 = countLeadingZeros(NUMBER);
// Words of the same depth whose entries find their places by comparing themselves.
const TIES: u32 = 8u;

// The words of a thread in a row.
struct Words {
    near: vec4<u32>,
    far: vec4<u32>,
}

var<workgroup> all_words: array<vec4<u32>, 2u * THREADS>;
// Bits in which the depths of a block differ.
var<workgroup> differing: atomic<u32>;
// 1: more entries than TIES have words of the same depth.
var<workgroup> tied: atomic<u32>;
var<workgroup> tied_now: u32;

// Puts in order the words beside each other.
fn order_pairs(v: vec4<u32>) -> vec4<u32> {
    let small = min(v.xz, v.yw);
    let large = max(v.xz, v.yw);
    return vec4(small.x, large.x, small.y, large.y);
}

// Puts in order the words whose distance is 4, then 2, then 1.
fn order_own(own: Words) -> Words {
    let near = min(own.near, own.far);
    let far = max(own.near, own.far);
    return Words(
        order_pairs(vec4(min(near.xy, near.zw), max(near.xy, near.zw))),
        order_pairs(vec4(min(far.xy, far.zw), max(far.xy, far.zw))),
    );
}

// A pair in order, and a pair in order behind it: all four.
fn join_pairs(v: vec4<u32>) -> vec4<u32> {
    let small = min(v.xy, v.wz);
    let large = max(v.xy, v.wz);
    return order_pairs(vec4(small, large.yx));
}

fn sort_own(own: Words) -> Words {
    let near = join_pairs(order_pairs(own.near));
    let far = join_pairs(order_pairs(own.far)).wzyx;
    return order_own(Words(near, far));
}

#if SUBGROUPS
// The words of the thread of the subgroup whose number differs by the bits of `mask`. Every thread of the subgroup calls it.
fn words_within(own: Words, mask: u32) -> Words {
    return Words(subgroupShuffleXor(own.near, mask), subgroupShuffleXor(own.far, mask));
}
#endif

// The words of the thread whose number differs by the bits of `mask`. Every thread calls it, in uniform control flow.
fn words_of(own: Words, thread: u32, mask: u32) -> Words {
    #if SUBGROUPS
    if mask < LANES {
        return words_within(own, mask);
    }
    #endif
    workgroupBarrier();
    all_words[2u * thread] = own.near;
    all_words[2u * thread + 1u] = own.far;
    workgroupBarrier();
    return Words(all_words[2u * (thread ^ mask)], all_words[2u * (thread ^ mask) + 1u]);
}

// The smaller words, or the larger ones.
fn choose(own: Words, other: Words, smaller: bool) -> Words {
    return Words(
        select(max(own.near, other.near), min(own.near, other.near), smaller),
        select(max(own.far, other.far), min(own.far, other.far), smaller),
    );
}

// Runs of `threads` threads are in order, and then those of twice as many. The first step compares the one with the other backwards.
fn join_runs(words: Words, thread: u32, threads: u32) -> Words {
    let facing = words_of(words, thread, 2u * threads - 1u);
    var own = choose(words, Words(facing.far.wzyx, facing.near.wzyx), (thread & threads) == 0u);
    for (var step = threads / 2u; step > 0u; step /= 2u) {
        own = choose(own, words_of(own, thread, step), (thread & step) == 0u);
    }
    return order_own(own);
}

#if SUBGROUPS
// The same for runs of a subgroup alone, whose other subgroups have nothing to join: no thread waits here.
fn join_runs_within(words: Words, thread: u32, threads: u32) -> Words {
    let facing = words_within(words, 2u * threads - 1u);
    var own = choose(words, Words(facing.far.wzyx, facing.near.wzyx), (thread & threads) == 0u);
    for (var step = threads / 2u; step > 0u; step /= 2u) {
        own = choose(own, words_within(own, step), (thread & step) == 0u);
    }
    return order_own(own);
}
#endif

// A word of the block, in order.
fn word_at(place: u32) -> u32 {
    return all_words[place / 4u][place % 4u];
}

fn has_same_depth(word: u32, other: u32) -> bool {
    return (word ^ other) <= NUMBER;
}

// The place of an entry among those whose words have the same depth, which are in the order of their numbers.
fn place_of(place: u32, word: u32, entry: vec2<u32>, start: u32, count: u32) -> u32 {
    var exact = place;
    for (var k = 1u; k <= min(place, TIES); k++) {
        let other = word_at(place - k);
        if !has_same_depth(word, other) {
            break;
        }
        exact -= u32(is_before(entry, list[start + (other & NUMBER)]));
    }
    for (var k = 1u; k < count - place; k++) {
        let other = word_at(place + k);
        if !has_same_depth(word, other) {
            break;
        }
        if k == TIES {
            atomicStore(&tied, 1u);
            break;
        }
        exact += u32(is_before(list[start + (other & NUMBER)], entry));
    }
    return exact;
}

// The words of `count` entries from `start` on, in order, which `word_at` gives too. `differing` is zero before and afterwards.
fn sorted_words(thread: u32, start: u32, count: u32) -> Words {
    let first_key = list[start].x;
    var own = Words(vec4(first_key), vec4(first_key));
    #repeat k 4
    if OWN * thread + $ku < count {
        own.near[$k] = list[start + OWN * thread + $ku].x;
    }
    if OWN * thread + 4u + $ku < count {
        own.far[$k] = list[start + OWN * thread + 4u + $ku].x;
    }
    #end
    let differ = (own.near ^ vec4(first_key)) | (own.far ^ vec4(first_key));
    var own_bits = differ.x | differ.y | differ.z | differ.w;
    #if SUBGROUPS
    own_bits = subgroupOr(own_bits);
    if thread % LANES == 0u {
        atomicOr(&differing, own_bits);
    }
    #else
    atomicOr(&differing, own_bits);
    #endif
    workgroupBarrier();
    let dropped = vec4(max(32u - countLeadingZeros(atomicLoad(&differing)), DEPTH_BITS) - DEPTH_BITS);
    let places = OWN * thread + vec4(0u, 1u, 2u, 3u);
    // Behind the last one lies what is larger than any, and stays there.
    own.near = select(vec4(0xffffffffu), ((own.near >> dropped) << vec4(32u - DEPTH_BITS)) | places, places < vec4(count));
    own.far = select(
        vec4(0xffffffffu),
        ((own.far >> dropped) << vec4(32u - DEPTH_BITS)) | (places + 4u),
        places + 4u < vec4(count),
    );
    own = sort_own(own);
    var threads = 1u;
    #if SUBGROUPS
    if OWN * (thread - thread % LANES) < count {
        for (var run = 1u; run < LANES && OWN * run < count; run *= 2u) {
            own = join_runs_within(own, thread, run);
        }
    }
    threads = LANES;
    #endif
    for (; OWN * threads < count; threads *= 2u) {
        own = join_runs(own, thread, threads);
    }
    workgroupBarrier();
    if thread == 0u {
        atomicStore(&differing, 0u);
    }
    all_words[2u * thread] = own.near;
    all_words[2u * thread + 1u] = own.far;
    workgroupBarrier();
    return own;
}
