// The pixels of a subgroup: a block of a tile. `LANES` is the size of a subgroup.
const BLOCK_COLUMNS: u32 = select(4u, 8u, LANES == 32u);
const BLOCK_ROWS: u32 = LANES / BLOCK_COLUMNS;

// The pixel of a lane within its tile.
fn block_pixel(subgroup: u32, lane: u32) -> vec2<u32> {
    const ACROSS = TILE / BLOCK_COLUMNS;
    let block = vec2(subgroup % ACROSS, subgroup / ACROSS) * vec2(BLOCK_COLUMNS, BLOCK_ROWS);
    return block + vec2(lane % BLOCK_COLUMNS, lane / BLOCK_COLUMNS);
}

// Whether a Gaussian may have alpha >= 1/255 at a pixel of a block; `first`: the block's first pixel centre, from the mean. If the
// mean lies outside, the falloff is least on one of the two edges that face it, where one coordinate is fixed.
fn reaches_block(first: vec2<f32>, shape: vec3<f32>, opacity: f32) -> bool {
    let last = first + vec2(f32(BLOCK_COLUMNS - 1u), f32(BLOCK_ROWS - 1u));
    let near = clamp(vec2(0.0), first, last);
    let y = clamp(shape.y * near.x, first.y, last.y);
    let lean = shape.y * shape.z;
    let x = clamp(lean * near.y / (shape.x + lean * shape.y), first.x, last.x);
    let least = min(falloff(vec2(near.x, y), shape), falloff(vec2(x, near.y), shape));
    return 2.0 * least <= outline_cut(opacity);
}
