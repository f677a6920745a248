// The tiles of a projected Gaussian, for the counter and the emitter alike: those of its outline, where alpha is 1/255, and with
// the published setting only those of its box too.
fn splat_cover(xy: vec2<f32>, radius: f32, shape: vec3<f32>, opacity: f32) -> TileCover {
    let tiles = frame_tiles();
    var box = vec4(vec2(0u), tiles);
    if frame.box_sigma > 0.0 {
        box = tile_rect(xy, radius, tiles);
    }
    return tile_cover(box, xy, shape, opacity);
}
