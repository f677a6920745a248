// A packed RGBA8 photo.

// Channel c, in 0..1.
fn photo_channel(texel: u32, c: u32) -> f32 {
    return f32((texel >> (8u * c)) & 255u) / 255.0;
}

// Alpha under one half marks a pixel that leaves the loss.
fn photo_valid(texel: u32) -> bool {
    return (texel >> 24u) >= 128u;
}
