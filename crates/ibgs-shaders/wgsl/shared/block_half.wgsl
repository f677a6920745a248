// The halves of a subgroup's block, side by side: of 32 lanes each half has 4 x 4 pixels. While a half walks an entry that does not
// reach the other, that one walks another.
#import block

const HALF_LANES: u32 = LANES / 2u;
const HALF_COLUMNS: u32 = BLOCK_COLUMNS / 2u;

// The pixel of a lane within its tile.
fn half_pixel(subgroup: u32, lane: u32) -> vec2<u32> {
    let own = lane % HALF_LANES;
    return block_corner(subgroup) + vec2(lane / HALF_LANES * HALF_COLUMNS + own % HALF_COLUMNS, own / HALF_COLUMNS);
}

// Those of the subgroup's entries, one a lane, that may reach the pixels of this lane's half, as bits; `first`: the block's first
// pixel centre, from the entry's mean. Every lane calls it.
fn reaching_half(lane: u32, counts: bool, first: vec2<f32>, shape: vec3<f32>, reach: vec2<f32>) -> u32 {
    const EXTENT = vec2(f32(HALF_COLUMNS - 1u), f32(BLOCK_ROWS - 1u));
    let left = subgroupBallot(counts && reaches(first, EXTENT, shape, reach)).x;
    let right = subgroupBallot(counts && reaches(first + vec2(f32(HALF_COLUMNS), 0.0), EXTENT, shape, reach)).x;
    return select(right, left, lane < HALF_LANES);
}
