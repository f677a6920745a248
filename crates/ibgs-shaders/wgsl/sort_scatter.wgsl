// Radix sort, scattering: stable, deterministic, without subgroup operations. In each round the 256 threads publish
// the bits of their digits as masks of 256 bits; a thread's rank among equal digits is the number of set bits before
// its own in the intersection of the eight masks.
#import index
#import sort_params
#import scan_block

@group(0) @binding(0) var<storage, read> keys_in: array<u32>;
@group(0) @binding(1) var<storage, read> values_in: array<u32>;
@group(0) @binding(2) var<storage, read> count: array<u32>;
// By digit and block: how many keys of the blocks before have the digit; behind that, by digit, how many of all.
@group(0) @binding(3) var<storage, read> histogram: array<u32>;
@group(0) @binding(4) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(5) var<storage, read_write> values_out: array<u32>;

// masks[8 * bit + word]: bit `t % 32` of word `t / 32` is set if thread t's digit has the bit; row 8 marks live threads.
var<workgroup> masks: array<atomic<u32>, 72>;
// Next free position of each digit.
var<workgroup> next: array<u32, SORT_BINS>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = linear_workgroup(wid, groups);
    let n = min(count[0], params.capacity);
    if block * SORT_BLOCK >= n {
        return;
    }
    let smaller = scan_block(local, histogram[SORT_BINS * params.blocks + local]).exclusive;
    next[local] = smaller + histogram[local * params.blocks + block];
    let word = local >> 5u;
    let lane = local & 31u;
    let rounds = min(SORT_BLOCK, n - block * SORT_BLOCK + 255u) / 256u;
    for (var k = 0u; k < rounds; k++) {
        let i = block * SORT_BLOCK + k * 256u + local;
        if local < 72u {
            atomicStore(&masks[local], 0u);
        }
        workgroupBarrier();
        let live = i < n;
        var key = 0u;
        var digit = 0u;
        if live {
            key = keys_in[i];
            digit = digit_of(key);
            for (var b = 0u; b < 8u; b++) {
                if ((digit >> b) & 1u) == 1u {
                    atomicOr(&masks[8u * b + word], 1u << lane);
                }
            }
            atomicOr(&masks[64u + word], 1u << lane);
        }
        workgroupBarrier();
        var before = 0u;
        var equal = 0u;
        if live {
            for (var w = 0u; w < 8u; w++) {
                var m = atomicLoad(&masks[64u + w]);
                for (var b = 0u; b < 8u; b++) {
                    let flip = ((digit >> b) & 1u) - 1u;
                    m &= atomicLoad(&masks[8u * b + w]) ^ flip;
                }
                equal += countOneBits(m);
                if w < word {
                    before += countOneBits(m);
                } else if w == word {
                    before += countOneBits(m & ((1u << lane) - 1u));
                }
            }
            let target_index = next[digit] + before;
            if target_index < params.capacity {
                keys_out[target_index] = key;
                var value = i;
                if params.first == 0u {
                    value = values_in[i];
                }
                values_out[target_index] = value;
            }
        }
        workgroupBarrier();
        if live && before + 1u == equal {
            next[digit] += equal;
        }
        workgroupBarrier();
    }
}
