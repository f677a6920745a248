// Bilinear resizing with corners aligned: value i of `to` reads source coordinate i (from - 1) / (to - 1). All positions
// are exact integer fractions, so that a resize and its transpose never disagree about who reads whom.

struct Axis {
    first: u32,
    second: u32,
    // Weight of `second`.
    fraction: f32,
}

fn resize_axis(i: u32, src: u32, dst: u32) -> Axis {
    let span = max(dst, 2u) - 1u;
    let scaled = i * (src - 1u);
    let first = scaled / span;
    return Axis(first, min(first + 1u, src - 1u), f32(scaled % span) / f32(span));
}

struct Corners {
    at: vec4<u32>,
    weight: vec4<f32>,
}

// The four source pixels of one resized pixel.
fn resize_corners(pixel: vec2<u32>, src: vec2<u32>, dst: vec2<u32>) -> Corners {
    let x = resize_axis(pixel.x, src.x, dst.x);
    let y = resize_axis(pixel.y, src.y, dst.y);
    let rows = vec2(y.first, y.second) * src.x;
    let across = vec2(1.0 - x.fraction, x.fraction);
    return Corners(
        vec4(rows.x + x.first, rows.x + x.second, rows.y + x.first, rows.y + x.second),
        vec4((1.0 - y.fraction) * across, y.fraction * across),
    );
}

// First and last resized index that may read source index k (some at the ends with weight zero).
fn resize_readers(k: u32, src: u32, dst: u32) -> vec2<u32> {
    if src == 1u {
        return vec2(0u, dst - 1u);
    }
    let span = dst - 1u;
    return vec2((max(k, 1u) - 1u) * span / (src - 1u), min((k + 1u) * span / (src - 1u), span));
}

// Weight with which resized index i reads source index k.
fn resize_weight(i: u32, k: u32, src: u32, dst: u32) -> f32 {
    let span = i32(max(dst, 2u) - 1u);
    let distance = abs(i32(i * (src - 1u)) - i32(k) * span);
    return max(1.0 - f32(distance) / f32(span), 0.0);
}
