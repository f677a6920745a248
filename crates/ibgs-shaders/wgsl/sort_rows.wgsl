// Radix sort, between counting and scattering: one workgroup a digit turns its row of the histogram, how many keys of each block
// have the digit, into how many of the blocks before have it. Behind the rows: how many of all keys have each digit.
#import sort_params
#import scan_block

@group(0) @binding(0) var<storage, read> count: array<u32>;
@group(0) @binding(1) var<storage, read_write> histogram: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let digit = wid.x;
    let n = min(count[0], params.capacity);
    let blocks = (n + SORT_BLOCK - 1u) / SORT_BLOCK;
    var carry = 0u;
    for (var first = 0u; first < blocks; first += 256u) {
        let at = digit * params.blocks + first + local;
        var value = 0u;
        if first + local < blocks {
            value = histogram[at];
        }
        let result = scan_block(local, value);
        if first + local < blocks {
            histogram[at] = carry + result.exclusive;
        }
        carry += result.total;
    }
    if local == 0u {
        histogram[SORT_BINS * params.blocks + digit] = carry;
    }
}
