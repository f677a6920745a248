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
    var carry = 0u;
    if block * SCAN_BLOCK < scan.count {
        carry = block_sums[block];
    }
    for (var k = 0u; k < SCAN_BLOCK / 256u; k++) {
        let i = block * SCAN_BLOCK + k * 256u + local;
        var value = 0u;
        if i < scan.count {
            value = values[i];
        }
        let result = scan_block(local, value);
        if i < scan.count {
            sums[i] = carry + result.exclusive;
        }
        carry += result.total;
    }
}
