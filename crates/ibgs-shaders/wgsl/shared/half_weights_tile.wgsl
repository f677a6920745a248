// How the kernels of weight gradients on the matrix units hold 3 SIDE channels of a pixel in workgroup memory. The kernel declares
// `params` with `inputs`.
#import half

const QUADS: u32 = SIDE / 4u;
const GROUP: u32 = 3u * QUADS;
// Groups of 8 channels, and the distance of pixels; the padding avoids bank conflicts.
const PAIRS: u32 = GROUP / 2u;
const PIXEL: u32 = GROUP + 2u;

// The first channel of the input's padding counts as 1, which makes the biases' gradient one more row of weights.
fn with_one(value: vec4<f16>, channel: u32) -> vec4<f16> {
    return select(value, vec4(1.0h), vec4(channel, channel + 1u, channel + 2u, channel + 3u) == vec4(params.inputs));
}
