// Halves: what is beyond their range becomes their largest number, so that no infinity comes up.
const HALF_MAX: f32 = 65504.0;

fn to_half(v: vec4<f32>) -> vec4<f16> {
    return vec4<f16>(clamp(v, vec4(-HALF_MAX), vec4(HALF_MAX)));
}
