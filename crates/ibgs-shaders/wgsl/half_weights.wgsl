//! All layers' weights to half precision in the order in which the matrix units read them.
#set matrix
#stage unet
// One thread four inputs of an output and tap: the weights of all layers in float32 to matrices in half precision, [input channels /
// SIDE][tap][outputs / SIDE][output][input], padded with zeros. For the gradient by the input the layer's outputs are the inputs
// here and the other way round, and the taps are turned by half a circle.
#import half
#import index

/// A layer's weights for the matrix units.
struct HalfWeights {
    /// First weight.
    weights: u32,
    /// Distance between the weights of neighbouring outputs.
    stride_out: u32,
    /// Distance between the weights of neighbouring inputs.
    stride_in: u32,
    /// Taps: 9 or 1.
    taps: u32,
    /// 1: the taps turned by half a circle.
    turned: u32,
    /// Channels of input a.
    channels_a: u32,
    /// Channels of input a with padding.
    padded_a: u32,
    /// Channels of input b.
    channels_b: u32,
    /// Channels of both inputs with padding.
    padded: u32,
    /// Output channels.
    outputs: u32,
    /// Groups of SIDE outputs.
    groups: u32,
    /// Where the result begins, in groups of 4; rises from layer to layer.
    into: u32,
}

/// All layers' weights for the matrix units.
struct HalfWeightsParams {
    /// How many layers there are.
    layers: u32,
    /// Groups of 4 weights in all.
    quads: u32,
}

var<immediate> params: HalfWeightsParams;

@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read> layers: array<HalfWeights>;
@group(0) @binding(2) var<storage, read_write> packed: array<vec4<f16>>;

const QUADS: u32 = SIDE / 4u;

fn weight(layer: HalfWeights, o: u32, i: u32, tap: u32) -> f32 {
    let second = i >= layer.padded_a;
    let own = select(i, i - layer.padded_a, second);
    let inside = o < layer.outputs && own < select(layer.channels_a, layer.channels_b, second);
    let channel = own + select(0u, layer.channels_a, second);
    let at = layer.weights + o * layer.stride_out + channel * layer.stride_in + tap;
    return select(0.0, weights[select(0u, at, inside)], inside);
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_workgroup(wid, groups) * 256u + local;
    if at >= params.quads {
        return;
    }
    var number = 0u;
    while number + 1u < params.layers && layers[number + 1u].into <= at {
        number++;
    }
    let layer = layers[number];
    let k = at - layer.into;
    let tap = k / (QUADS * SIDE * layer.groups);
    let i = (tap / layer.taps) * SIDE + 4u * (k % QUADS);
    let o = (k / QUADS) % (SIDE * layer.groups);
    let own = tap % layer.taps;
    let source = select(own, layer.taps - 1u - own, layer.turned == 1u);
    packed[at] = to_half(vec4(
        weight(layer, o, i, source),
        weight(layer, o, i + 1u, source),
        weight(layer, o, i + 2u, source),
        weight(layer, o, i + 3u, source),
    ));
}
