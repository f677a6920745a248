// Last step: exclusive prefix sum inside every block, plus the block's start.
#import index
#import scan_block
#import scan_length

@group(0) @binding(0) var<storage, read> values: array<u32>;
@group(0) @binding(1) var<storage, read> block_sums: array<u32>;
@group(0) @binding(2) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = linear_workgroup(wid, groups);
    // Each thread has values in a row.
    let first = block * SCAN_BLOCK + local * (SCAN_BLOCK / 256u);
    let behind = min(first + SCAN_BLOCK / 256u, scan.count);
    var own = 0u;
    for (var i = first; i < behind; i++) {
        own += values[i];
    }
    var sum = scan_block(local, own).exclusive;
    if first < behind {
        sum += block_sums[block];
    }
    for (var i = first; i < behind; i++) {
        sums[i] = sum;
        sum += values[i];
    }
}
