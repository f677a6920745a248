// Sums over a subgroup of 16 numbers of each lane, in a fixed order. At each step a lane keeps half of its numbers and gives the
// others to the lane that keeps those. In the end lane l has the sum 16 l / LANES. Every lane calls it.
fn subgroup_sums(lane: u32, a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, d: vec4<f32>) -> f32 {
    var upper = (lane & (LANES / 2u)) != 0u;
    let ab = select(a, c, upper) + subgroupShuffleXor(select(c, a, upper), LANES / 2u);
    let cd = select(b, d, upper) + subgroupShuffleXor(select(d, b, upper), LANES / 2u);
    upper = (lane & (LANES / 4u)) != 0u;
    let four = select(ab, cd, upper) + subgroupShuffleXor(select(cd, ab, upper), LANES / 4u);
    upper = (lane & (LANES / 8u)) != 0u;
    let two = select(four.xy, four.zw, upper) + subgroupShuffleXor(select(four.zw, four.xy, upper), LANES / 8u);
    upper = (lane & (LANES / 16u)) != 0u;
    var one = select(two.x, two.y, upper) + subgroupShuffleXor(select(two.y, two.x, upper), LANES / 16u);
    if LANES == 32u {
        one += subgroupShuffleXor(one, 1u);
    }
    return one;
}
