// The number of a workgroup's tile: those with long lists come first, so that the device is not left with one of them when all others
// are done. The kernel declares the uniforms and `tile_ranges`.
fn tile_of(wid: vec3<u32>) -> u32 {
    let tiles = frame_tiles();
    let behind_ranges = 2u * (tiles.x * tiles.y + 1u);
    return tile_ranges[behind_ranges + wid.y * tiles.x + wid.x];
}

// Its first pixel.
fn corner_of(tile: u32) -> vec2<u32> {
    let columns = frame_tiles().x;
    return vec2(tile % columns, tile / columns) * TILE;
}
