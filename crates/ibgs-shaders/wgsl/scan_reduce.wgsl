//! Prefix sum, block sums.
#set render
#stage sort
// First step of the prefix sum: the sum of every block of SCAN_BLOCK elements.
#import index
#import scan_block
#import count_params

@group(0) @binding(0) var<storage, read> values: array<u32>;
@group(0) @binding(1) var<storage, read_write> block_sums: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = linear_workgroup(wid, groups);
    var sum = 0u;
    for (var k = 0u; k < SCAN_BLOCK / 256u; k++) {
        let i = block * SCAN_BLOCK + k * 256u + local;
        if i < params.count {
            sum += values[i];
        }
    }
    let result = scan_block(local, sum);
    if local == 0u && block * SCAN_BLOCK < params.count {
        block_sums[block] = result.total;
    }
}
