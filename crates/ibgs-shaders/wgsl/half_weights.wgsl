// One thread four inputs of an output and tap: a layer's weights in float32 to matrices in half precision, [input channels /
// SIDE][tap][outputs / SIDE][output][input], padded with zeros. For the gradient by the input the layer's outputs are the inputs
// here and the other way round, and the taps are turned by half a circle.
#import half
#import index

struct HalfWeightsParams {
    // First weight; distances between the weights of neighbouring outputs and inputs.
    weights: u32,
    stride_out: u32,
    stride_in: u32,
    taps: u32,
    // 1: taps turned.
    turned: u32,
    // Channels of input a, and with padding; those of b, and of both with padding.
    channels_a: u32,
    padded_a: u32,
    channels_b: u32,
    padded: u32,
    outputs: u32,
    // Groups of SIDE outputs.
    groups: u32,
    // Where the result begins, in groups of 4.
    into: u32,
}

var<immediate> params: HalfWeightsParams;

@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read_write> packed: array<vec4<f16>>;

const QUADS: u32 = SIDE / 4u;

fn weight(o: u32, i: u32, tap: u32) -> f32 {
    let second = i >= params.padded_a;
    let own = select(i, i - params.padded_a, second);
    let inside = o < params.outputs && own < select(params.channels_a, params.channels_b, second);
    let channel = own + select(0u, params.channels_a, second);
    let at = params.weights + o * params.stride_out + channel * params.stride_in + tap;
    return select(0.0, weights[select(0u, at, inside)], inside);
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let k = linear_workgroup(wid, groups) * 256u + local;
    let tap = k / (QUADS * SIDE * params.groups);
    let chunk = tap / params.taps;
    if chunk * SIDE >= params.padded {
        return;
    }
    let i = chunk * SIDE + 4u * (k % QUADS);
    let o = (k / QUADS) % (SIDE * params.groups);
    let own = tap % params.taps;
    let source = select(own, params.taps - 1u - own, params.turned == 1u);
    packed[params.into + k] =
        to_half(vec4(weight(o, i, source), weight(o, i + 1u, source), weight(o, i + 2u, source), weight(o, i + 3u, source)));
}
