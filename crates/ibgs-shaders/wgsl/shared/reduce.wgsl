// Sum over a workgroup of THREADS, a power of two that the kernel declares, in a fixed order. Every thread calls it, in uniform control
// flow, and gets the sum.
var<workgroup> reduce_sums: array<vec4<f32>, THREADS>;

fn reduce(local: u32, value: vec4<f32>) -> vec4<f32> {
    // The sum of the call before may still be read.
    workgroupBarrier();
    reduce_sums[local] = value;
    workgroupBarrier();
    for (var step = THREADS / 2u; step > 0u; step >>= 1u) {
        if local < step {
            reduce_sums[local] += reduce_sums[local + step];
        }
        workgroupBarrier();
    }
    return reduce_sums[0];
}
