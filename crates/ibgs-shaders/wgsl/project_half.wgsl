//! As [`PROJECT`], with spherical harmonics in half precision.
#set render
#stage project
// One thread a Gaussian: cull, project, colour, number of tiles touched (method.md section 2).
// The coefficients are halves.
#import project

/// Three words for two coefficients: (r, g), (b, r), (g, b).
@group(0) @binding(4) var<storage, read> sh: array<u32>;

// The number of a half's 16 bits, by hand: some drivers lack the built-in function. Infinities and NaNs stay what they are.
fn number(bits: u32) -> f32 {
    let magnitude = (bits & 0x7fffu) << 13u;
    // The exponents of halves and floats have their zeros at 15 and 127. Halves below 2^-14 have no leading one: it is taken away
    // again, as not every driver knows such floats.
    let usual = bitcast<f32>(magnitude + 0x38000000u);
    let small = bitcast<f32>(magnitude + 0x38800000u) - 0x1p-14;
    var value = select(usual, small, magnitude < 0x00800000u);
    value = select(value, bitcast<f32>(magnitude | 0x7f800000u), magnitude >= 0x0f800000u);
    return select(value, -value, (bits & 0x8000u) != 0u);
}

fn numbers(word: u32) -> vec2<f32> {
    return vec2(number(word & 0xffffu), number(word >> 16u));
}

// Not clamped at 0 yet, because clamping would hide values that are not finite.
fn splat_color(i: u32, direction: vec3<f32>) -> vec3<f32> {
    let basis = sh_basis(direction, frame.sh_degree);
    var color = vec3(0.5);
    let base = i * 3u * ((frame.sh_coefficients + 1u) / 2u);
    let count = sh_count(frame.sh_degree);
    for (var c = 0u; c < count; c += 2u) {
        let at = base + 3u * (c / 2u);
        let rg = numbers(sh[at]);
        let br = numbers(sh[at + 1u]);
        let gb = numbers(sh[at + 2u]);
        color += basis[c] * vec3(rg, br.x);
        if c + 1u < count {
            color += basis[c + 1u] * vec3(br.y, gb);
        }
    }
    return color;
}
