// Sum over the THREADS of a tile in a fixed order, by the subgroups where these have a fixed size; the first thread gets it. Every thread
// calls it once, in uniform control flow.
#if SUBGROUPS
var<workgroup> reduce_sums: array<vec4<f32>, THREADS / LANES>;

fn reduce_tile(local: u32, subgroup: u32, lane: u32, value: vec4<f32>) -> vec4<f32> {
    var sum = value;
    for (var step = LANES / 2u; step > 0u; step >>= 1u) {
        sum += subgroupShuffleXor(sum, step);
    }
    if lane == 0u {
        reduce_sums[subgroup] = sum;
    }
    workgroupBarrier();
    var total = vec4(0.0);
    if local == 0u {
        for (var s = 0u; s < THREADS / LANES; s++) {
            total += reduce_sums[s];
        }
    }
    return total;
}
#else
#import reduce

fn reduce_tile(local: u32, subgroup: u32, lane: u32, value: vec4<f32>) -> vec4<f32> {
    return reduce(local, value);
}
#endif
