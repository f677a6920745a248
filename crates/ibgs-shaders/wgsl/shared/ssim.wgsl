// Shared pieces of the L1 + SSIM loss (method.md section 7): an 11 x 11 Gaussian window, separable, zero padding.

struct LossParams {
    size: vec2<u32>,
    tiles: vec2<u32>,
    // Weight of 1 - SSIM; L1 has the rest.
    lambda: f32,
    pad: f32,
}

var<immediate> params: LossParams;

const RADIUS: u32 = 5u;
// A tile with its halo.
const SIDE: u32 = TILE + 2u * RADIUS;

// Index of pixel `tile origin + offset - RADIUS`, or -1 outside the image.
fn halo_pixel(tile: vec2<u32>, k: u32) -> i32 {
    let at = vec2<i32>(tile * TILE + vec2(k % SIDE, k / SIDE)) - i32(RADIUS);
    if any(at < vec2(0)) || any(at >= vec2<i32>(params.size)) {
        return -1;
    }
    return at.y * i32(params.size.x) + at.x;
}

// Channel c of a packed RGBA8 photo, in 0..1.
fn photo_channel(texel: u32, c: u32) -> f32 {
    return f32((texel >> (8u * c)) & 255u) / 255.0;
}

// Alpha under one half marks a pixel that leaves the loss.
fn photo_valid(texel: u32) -> bool {
    return (texel >> 24u) >= 128u;
}
