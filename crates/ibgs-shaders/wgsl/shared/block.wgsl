// The pixels of a subgroup: a block of a tile. `LANES` is the size of a subgroup; of 8 lanes each has four pixels of a column.
const BLOCK_COLUMNS: u32 = select(8u, 4u, LANES == 16u);
const BLOCK_ROWS: u32 = 4u;

// The first pixel of a block within its tile.
fn block_corner(subgroup: u32) -> vec2<u32> {
    const ACROSS = TILE / BLOCK_COLUMNS;
    return vec2(subgroup % ACROSS, subgroup / ACROSS) * vec2(BLOCK_COLUMNS, BLOCK_ROWS);
}

// The pixel of a lane within its tile.
fn block_pixel(subgroup: u32, lane: u32) -> vec2<u32> {
    return block_corner(subgroup) + vec2(lane % BLOCK_COLUMNS, lane / BLOCK_COLUMNS);
}

// What the test of a Gaussian against blocks needs beside its shape: twice the falloff at its outline, and dx/dy of the line through
// the mean where the falloff along a row is least.
fn block_reach(shape: vec3<f32>, opacity: f32) -> vec2<f32> {
    let lean = shape.y * shape.z;
    return vec2(outline_cut(opacity), lean / (shape.x + lean * shape.y));
}

// Whether a Gaussian may have alpha >= 1/255 at a pixel of a block; `first`: the block's first pixel centre, from the mean;
// `extent`: from it to the last. If the mean lies outside, the falloff is least on one of the two edges that face it, where one
// coordinate is fixed.
fn reaches(first: vec2<f32>, extent: vec2<f32>, shape: vec3<f32>, reach: vec2<f32>) -> bool {
    let last = first + extent;
    let near = clamp(vec2(0.0), first, last);
    let y = clamp(shape.y * near.x, first.y, last.y);
    let x = clamp(reach.y * near.y, first.x, last.x);
    let least = min(falloff(vec2(near.x, y), shape), falloff(vec2(x, near.y), shape));
    return 2.0 * least <= reach.x;
}

// The same for the block of a subgroup.
fn reaches_block(first: vec2<f32>, shape: vec3<f32>, opacity: f32) -> bool {
    return reaches(first, vec2(f32(BLOCK_COLUMNS - 1u), f32(BLOCK_ROWS - 1u)), shape, block_reach(shape, opacity));
}
