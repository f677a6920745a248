// Conversion to half precision. A value out of range becomes the largest half, so that no infinity arises.
const HALF_MAX: f32 = 65504.0;

fn to_half(v: vec4<f32>) -> vec4<f16> {
    return vec4<f16>(clamp(v, vec4(-HALF_MAX), vec4(HALF_MAX)));
}

/// Eight channels, which are read at once.
struct Pair {
    /// The first four.
    a: vec4<f16>,
    /// The others.
    b: vec4<f16>,
}

fn larger(x: Pair, y: Pair) -> Pair {
    return Pair(max(x.a, y.a), max(x.b, y.b));
}
