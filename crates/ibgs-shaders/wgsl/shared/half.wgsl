// Conversion to half precision. A value out of range becomes the largest half, so that no infinity arises.
const HALF_MAX: f32 = 65504.0;

fn to_half(v: vec4<f32>) -> vec4<f16> {
    return vec4<f16>(clamp(v, vec4(-HALF_MAX), vec4(HALF_MAX)));
}
