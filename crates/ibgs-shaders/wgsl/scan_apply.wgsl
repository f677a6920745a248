//! Prefix sum, grand total.
#set render
#stage sort
// Second step: exclusive prefix sum inside every block, plus the sum of the blocks before, which each workgroup adds up by itself: that
// takes less time than a launch in between. The last block writes the grand total.
#import index
#import scan_block
#import count_params

@group(0) @binding(0) var<storage, read> values: array<u32>;
@group(0) @binding(1) var<storage, read> block_sums: array<u32>;
@group(0) @binding(2) var<storage, read_write> sums: array<u32>;
@group(0) @binding(3) var<storage, read_write> total: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = linear_workgroup(wid, groups);
    let blocks = (params.count + SCAN_BLOCK - 1u) / SCAN_BLOCK;
    var before = 0u;
    for (var k = local; k < min(block, blocks); k += 256u) {
        before += block_sums[k];
    }
    let start = scan_block(local, before).total;
    // Each thread has values in a row.
    let first = block * SCAN_BLOCK + local * (SCAN_BLOCK / 256u);
    let behind = min(first + SCAN_BLOCK / 256u, params.count);
    var own = 0u;
    for (var i = first; i < behind; i++) {
        own += values[i];
    }
    let scanned = scan_block(local, own);
    var sum = start + scanned.exclusive;
    for (var i = first; i < behind; i++) {
        sums[i] = sum;
        sum += values[i];
    }
    if local == 0u && block + 1u == max(blocks, 1u) {
        total[0] = start + scanned.total;
    }
}
