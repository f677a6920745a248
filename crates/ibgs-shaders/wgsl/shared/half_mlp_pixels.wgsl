// What half_features_backward.wgsl keeps of its pixels in workgroup memory.
//
// The per-view MLP is two products of matrices over the pixels of a subgroup: hidden = ReLU(W1 F), (outputs, confidence) =
// W2 [hidden, F], where F are the numbers of a source, a one, and the error of its depth; the weights of the one are the
// biases. Values pass through workgroup memory in half precision, sums in float32, SIDE channels at a time: the less of it a subgroup
// needs, the more of them run at once.
#import residual_feature
#import half_mlp

const SUBGROUPS: u32 = 4u;
const THREADS: u32 = SUBGROUPS * LANES;
const QUADS: u32 = SIDE / 4u;
const CONFIDENCE_AT: u32 = HIDDEN / 4u;
// Distances in workgroup memory; the padding avoids bank conflicts.
const HIDDEN_LINE: u32 = HIDDEN / 4u + 2u;
const SUMS: u32 = QUADS + 1u;

// [pixel]: F of a source; its hidden channels, then the gradient by them; gradient by the outputs and the confidence; sums.
var<workgroup> inputs: array<vec4<f16>, THREADS * F_LINE>;
var<workgroup> hidden: array<vec4<f16>, THREADS * HIDDEN_LINE>;
var<workgroup> gradient: array<vec4<f16>, THREADS * LINE>;
var<workgroup> sums: array<vec4<f32>, THREADS * SUMS>;

// F of a source.
fn put_inputs(local: u32, f: Feature, error: f32) {
    let own = local * F_LINE;
    var numbers = f.numbers;
    numbers[ERROR / 4u][ERROR % 4u] = error;
    #repeat q 4
    inputs[own + $qu] = to_half(numbers[$qu]);
    #end
}
