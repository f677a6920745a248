// The tile of a workgroup, in tiles from the upper left: those with long lists come first, so that the device is not left with one of
// them when all others are done. The kernel declares the uniforms and `tile_ranges`.
fn tile_of(wid: vec3<u32>) -> vec2<u32> {
    let tiles = frame_tiles();
    let behind_ranges = 2u * (tiles.x * tiles.y + 1u);
    let tile = tile_ranges[behind_ranges + wid.y * tiles.x + wid.x];
    return vec2(tile % tiles.x, tile / tiles.x);
}

// Its number.
fn number_of(tile: vec2<u32>) -> u32 {
    return tile.y * frame_tiles().x + tile.x;
}
