// Sum over a workgroup of 256 in a fixed order. Every thread calls it, in uniform control flow, and gets the sum.
var<workgroup> reduce_sums: array<vec4<f32>, 256>;

fn reduce(local: u32, value: vec4<f32>) -> vec4<f32> {
    // The sum of the call before may still be read.
    workgroupBarrier();
    reduce_sums[local] = value;
    workgroupBarrier();
    for (var step = 128u; step > 0u; step >>= 1u) {
        if local < step {
            reduce_sums[local] += reduce_sums[local + step];
        }
        workgroupBarrier();
    }
    return reduce_sums[0];
}
