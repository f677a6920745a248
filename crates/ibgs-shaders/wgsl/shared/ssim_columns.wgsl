// For processors: a subgroup walks down a tile with its halo, of which each lane has four columns. The means of a row of the tile
// are complete RADIUS rows below it, those of columns 8 h + lane in the lane. Rows and columns count from the corner of the halo.

const COLUMNS: u32 = 4u;
const_assert LANES * COLUMNS >= SIDE && TILE == 2u * LANES;

// Whether column k of the lane is in the image.
fn is_inside(tile: vec2<u32>, k: u32, row: u32, lane: u32) -> bool {
    let at = tile * TILE + vec2(k * LANES + lane, row);
    return k * LANES + lane < SIDE && all(at >= vec2(RADIUS)) && all(at < params.size + RADIUS);
}

// Its pixel, or one at the image's border.
fn column_pixel(tile: vec2<u32>, k: u32, row: u32, lane: u32) -> u32 {
    let at = min(max(tile * TILE + vec2(k * LANES + lane, row), vec2(RADIUS)) - RADIUS, params.size - 1u);
    return at.y * params.size.x + at.x;
}

// Whether it is no part of the halo.
fn is_of_tile(k: u32, row: u32, lane: u32) -> bool {
    let at = vec2(k * LANES + lane, row) - RADIUS;
    return all(at < vec2(TILE));
}

// Whether the row completes a pixel of the image.
fn is_complete(tile: vec2<u32>, h: u32, row: u32, lane: u32) -> bool {
    return row >= 2u * RADIUS && all(tile * TILE + vec2(h * LANES + lane, row - 2u * RADIUS) < params.size);
}

fn complete_pixel(tile: vec2<u32>, h: u32, row: u32, lane: u32) -> u32 {
    return (tile.y * TILE + row - 2u * RADIUS) * params.size.x + tile.x * TILE + h * LANES + lane;
}
