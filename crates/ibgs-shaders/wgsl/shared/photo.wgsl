// A packed RGBA8 photo.

// Channel c, in 0..1.
fn photo_channel(texel: u32, c: u32) -> f32 {
    return f32((texel >> (8u * c)) & 255u) / 255.0;
}

// Share of a pixel that the object of a masked photo covers: alpha from ALPHA_EMPTY, none of it, to 255. Alpha 0 is where
// there is no photo.
fn photo_cover(texel: u32) -> f32 {
    let alpha = max(texel >> 24u, ALPHA_EMPTY);
    return f32(alpha - ALPHA_EMPTY) / f32(255u - ALPHA_EMPTY);
}

// Alpha under one half marks a pixel that leaves the loss.
fn photo_valid(texel: u32) -> bool {
    return (texel >> 24u) >= 128u;
}
