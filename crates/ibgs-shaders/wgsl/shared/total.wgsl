// Sum over a subgroup of 8 lanes, for each of them.
fn total(x: f32, lane: u32) -> f32 {
    let two = x + subgroupShuffle(x, lane ^ 1u);
    let four = two + subgroupShuffle(two, lane ^ 2u);
    return four + subgroupShuffle(four, lane ^ 4u);
}
