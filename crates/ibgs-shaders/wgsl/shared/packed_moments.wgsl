// Both moments of a value of Adam in a code: the root s of the second as a logarithm in MOMENT2_BITS bits (0: zero), the first as
// the ratio r = m1 / s in MOMENT1_BITS bits, signed and with its square root in even steps. Rounding is stochastic: the expected
// moments are those that are packed, but where s is below the smallest step, whose first moment is lost with it.
const MOMENT_BITS: u32 = MOMENT1_BITS + MOMENT2_BITS;
const SCALE_MOST: f32 = f32((1u << MOMENT2_BITS) - 1u);
// Binary logarithms of the smallest s and of the largest, from code 1 to SCALE_MOST.
const SCALE_FIRST: f32 = -44.0;
const SCALE_LAST: f32 = 4.0;
const SCALE_STEP: f32 = (SCALE_LAST - SCALE_FIRST) / (SCALE_MOST - 1.0);
// With decays of 0.9 and 0.999 the ratio stays below 7.3.
const RATIO_MOST: f32 = 7.3;
const RATIO_STEPS: f32 = f32((1u << (MOMENT1_BITS - 1u)) - 1u);

// Between 0 and 1, both excluded.
fn unit16(bits: u32) -> f32 {
    return (f32(bits & 0xffffu) + 0.5) / 65536.0;
}

// The root of the second moment of a code of it.
fn scale_of(code: f32) -> f32 {
    return select(exp2(SCALE_FIRST + (code - 1.0) * SCALE_STEP), 0.0, code == 0.0);
}

// First and second moment of a code.
fn unpack_moments(code: u32) -> vec2<f32> {
    let scale = scale_of(f32(extractBits(code, 0u, MOMENT2_BITS)));
    let steps = f32(extractBits(bitcast<i32>(code), MOMENT2_BITS, MOMENT1_BITS)) / RATIO_STEPS;
    return vec2(RATIO_MOST * steps * abs(steps) * scale, scale * scale);
}

// The code of first and second moment, rounded by 32 random bits.
fn pack_moments(m: vec2<f32>, random: u32) -> u32 {
    // The step below, and how far the second moment is on its way to the next.
    let at = (0.5 * log2(max(m.y, 1e-37)) - SCALE_FIRST) / SCALE_STEP;
    let below = clamp(floor(at), 0.0, SCALE_MOST - 2.0);
    var part = (exp2(2.0 * SCALE_STEP * (at - below)) - 1.0) / (exp2(2.0 * SCALE_STEP) - 1.0);
    var code = below + 1.0;
    if at < 0.0 {
        part = exp2(2.0 * SCALE_STEP * at);
        code = 0.0;
    }
    code += select(0.0, 1.0, unit16(random) < part);
    let scale = scale_of(code);
    if scale == 0.0 {
        return 0u;
    }
    // In units in which the steps are the squares of whole numbers.
    let ratio = min(abs(m.x) / scale / RATIO_MOST, 1.0) * RATIO_STEPS * RATIO_STEPS;
    let root = min(floor(sqrt(ratio)), RATIO_STEPS - 1.0);
    let up = unit16(random >> 16u) * (2.0 * root + 1.0) < ratio - root * root;
    let steps = i32(root) + select(0, 1, up);
    return insertBits(u32(code), bitcast<u32>(select(steps, -steps, m.x < 0.0)), MOMENT2_BITS, MOMENT1_BITS);
}

// The codes of three values in two words: two at the bottom, the third in what is left of both.
fn split_codes(words: vec2<u32>) -> vec3<u32> {
    let both = extractBits(words, 0u, MOMENT_BITS);
    let rest = words >> vec2(MOMENT_BITS);
    return vec3(both, insertBits(rest.x, rest.y, 32u - MOMENT_BITS, 2u * MOMENT_BITS - 32u));
}

fn join_codes(codes: vec3<u32>) -> vec2<u32> {
    let rest = vec2(codes.z, codes.z >> (32u - MOMENT_BITS));
    return insertBits(codes.xy, rest, MOMENT_BITS, 32u - MOMENT_BITS);
}
