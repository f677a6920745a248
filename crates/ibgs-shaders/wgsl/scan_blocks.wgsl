// Second step: exclusive prefix sum of the block sums in place, by one workgroup; writes the grand total.
#import scan_block
#import scan_length

@group(0) @binding(0) var<storage, read_write> block_sums: array<u32>;
@group(0) @binding(1) var<storage, read_write> total: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) local: u32) {
    let blocks = (scan.count + SCAN_BLOCK - 1u) / SCAN_BLOCK;
    var carry = 0u;
    for (var start = 0u; start < blocks; start += 256u) {
        let i = start + local;
        var value = 0u;
        if i < blocks {
            value = block_sums[i];
        }
        let result = scan_block(local, value);
        if i < blocks {
            block_sums[i] = carry + result.exclusive;
        }
        carry += result.total;
    }
    if local == 0u {
        total[0] = carry;
    }
}
