//! Values that are not finite, counted.
#set train
#stage other
// One thread a value: counts the values that are not finite. It tests their bits, because compilers may assume that
// floats are finite.
#import count_params
#import index

@group(0) @binding(0) var<storage, read> values: array<u32>;
@group(0) @binding(1) var<storage, read_write> broken: array<atomic<u32>>;

const EXPONENT: u32 = 0x7f800000u;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    if i < params.count && (values[i] & EXPONENT) == EXPONENT {
        atomicAdd(&broken[0], 1u);
    }
}
