// The per-view MLP for processors. A driver in software reads memory lane by lane and exchanges lanes in one instruction. So the lanes
// are channels, of one pixel after the other: 32 channels are four numbers of each lane, and the weights stay where they are.
#import total

// Of channel 8 q + lane. Weights of the first layer by [q][number], of the second by [q][input], and of the confidence; the biases.
var<private> weight1: array<f32, 4u * MLP_FEATURES>;
var<private> weight2: array<f32, 128>;
var<private> bias1: array<f32, 4>;
var<private> bias2: array<f32, 4>;
var<private> by_hidden: array<f32, 4>;
// Weight of the depth's error in the confidence, and its bias.
var<private> by_error: vec2<f32>;

// Of one pixel and source: its numbers, the hidden channels, all of them too, and the outputs.
var<private> numbers: array<f32, MLP_FEATURES>;
var<private> hidden: array<f32, 4>;
var<private> all_hidden: array<f32, HIDDEN>;
var<private> outputs: array<f32, 4>;

fn load_mlp(lane: u32) {
    by_error = vec2(weights[CONFIDENCE_OFFSET + HIDDEN], weights[CONFIDENCE_OFFSET + HIDDEN + 1u]);
    #repeat q 4
    {
        let channel = 8u * $qu + lane;
        bias1[$q] = weights[BIAS1 + channel];
        bias2[$q] = weights[BIAS2 + channel];
        by_hidden[$q] = weights[CONFIDENCE_OFFSET + channel];
        #repeat n MLP_FEATURES
        weight1[$qu * FEATURES + $nu] = weights[channel * FEATURES + $nu];
        #end
        #repeat n 32
        weight2[32 * $q + $n] = weights[WEIGHT2 + channel * HIDDEN + $nu];
        #end
    }
    #end
}

// Runs the MLP on a pixel, of whose numbers its lane has all. Sums are those of residual_mlp, bit for bit.
fn forward(f: Feature, pixel: u32) {
    #repeat n MLP_FEATURES
    numbers[$n] = subgroupShuffle(f.numbers[$nu / 4u][$nu % 4u], pixel);
    #end
    #repeat q 4
    {
        var parts: array<f32, MLP_QUADS>;
        #repeat n MLP_FEATURES
        {
            let term = numbers[$n] * weight1[$qu * FEATURES + $nu];
            parts[$nu / 4u] = select(parts[$nu / 4u] + term, term, $nu % 4u == 0u);
        }
        #end
        var sum = 0.0;
        #repeat m MLP_QUADS
        sum = select(sum + parts[$m], parts[$m], $m == 0);
        #end
        hidden[$q] = max(sum + bias1[$q], 0.0);
        outputs[$q] = bias2[$q];
    }
    #end
    #repeat k 32
    all_hidden[$k] = subgroupShuffle(hidden[$k / 8], $ku % 8u);
    #repeat q 4
    outputs[$q] += all_hidden[$k] * weight2[32 * $q + $k];
    #end
    #end
    #repeat q 4
    outputs[$q] = max(outputs[$q], 0.0);
    #end
}
