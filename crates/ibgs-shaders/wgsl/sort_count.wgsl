// Radix sort, counting: histogram of one 8-bit digit for every block of SORT_BLOCK keys, stored digit-major. Only the columns of
// blocks that hold keys are written.
#import index
#import sort_params

@group(0) @binding(0) var<storage, read> keys: array<u32>;
@group(0) @binding(1) var<storage, read> count: array<u32>;
@group(0) @binding(2) var<storage, read_write> histogram: array<u32>;

var<workgroup> bins: array<atomic<u32>, SORT_BINS>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = linear_workgroup(wid, groups);
    let n = min(count[0], params.capacity);
    if block * SORT_BLOCK >= n {
        // Nothing to sort here: the buffers hold more than there are keys.
        return;
    }
    atomicStore(&bins[local], 0u);
    workgroupBarrier();
    for (var k = 0u; k < SORT_BLOCK / 256u; k++) {
        let i = block * SORT_BLOCK + k * 256u + local;
        if i < n {
            atomicAdd(&bins[digit_of(keys[i])], 1u);
        }
    }
    workgroupBarrier();
    histogram[local * params.blocks + block] = atomicLoad(&bins[local]);
}
