// For processors, one subgroup a workgroup. The lanes are pixels where they read the image, and channels where they compute. Weights
// and their sums stay where they are.
#import residual_mlp_narrow

// Of channel 8 q + lane: weights of the second layer by [q][output], and the sums of all gradients, as their weights.
var<private> turned2: array<f32, 128>;
var<private> v_weight1: array<f32, 4u * MLP_FEATURES>;
var<private> v_weight2: array<f32, 128>;
var<private> v_bias1: array<f32, 4>;
var<private> v_bias2: array<f32, 4>;
var<private> v_by_hidden: array<f32, 4>;

// Of eight pixels: numbers and presence of each source, and [pixel][q] of the gradient by the outputs.
var<private> features: array<Feature, 4>;
var<private> presences: array<vec2<f32>, 4>;
var<private> gradients: array<vec4<f32>, LANES>;

// Gradients of a pixel's source: `v`, by the outputs, and that by the logarithm of its confidence. Returns that by its colour and
// cosine.
fn backward(v: vec4<f32>, v_confidence: f32, lane: u32) -> vec4<f32> {
    var v_hidden = v_confidence * vec4(by_hidden[0], by_hidden[1], by_hidden[2], by_hidden[3]);
    #repeat k 32
    {
        let x = all_hidden[$k];
        let by = subgroupShuffle(v[$k / 8], $ku % 8u);
        #repeat q 4
        v_weight2[32 * $q + $k] = fma(v[$q], x, v_weight2[32 * $q + $k]);
        v_hidden[$q] = fma(turned2[32 * $q + $k], by, v_hidden[$q]);
        #end
    }
    #end
    var by_input = vec4(0.0);
    #repeat q 4
    {
        v_bias2[$q] += v[$q];
        v_by_hidden[$q] = fma(v_confidence, hidden[$q], v_by_hidden[$q]);
        let v_own = select(0.0, v_hidden[$q], hidden[$q] > 0.0);
        v_bias1[$q] += v_own;
        #repeat n MLP_FEATURES
        v_weight1[$qu * FEATURES + $nu] = fma(v_own, numbers[$n], v_weight1[$qu * FEATURES + $nu]);
        #end
        let first = $qu * FEATURES;
        by_input += v_own * vec4(weight1[first], weight1[first + 1u], weight1[first + 2u], weight1[first + 6u]);
    }
    #end
    return vec4(total(by_input.x, lane), total(by_input.y, lane), total(by_input.z, lane), total(by_input.w, lane));
}

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(subgroup_invocation_id) lane: u32) {
    load_mlp(lane);
    #repeat q 4
    #repeat n 32
    turned2[32 * $q + $n] = weights[WEIGHT2 + $nu * HIDDEN + 8u * $qu + lane];
    #end
    #end
    var v_by_error = vec2(0.0);
    let pixels = params.low.x * params.low.y;
    let used = used_sources();
    let is_soft = params.aggregation == AGGREGATION_SOFT;
    for (var start = wid.x * LANES; start < pixels; start += params.groups * LANES) {
        let inside = start + lane < pixels;
        let own = min(start + lane, pixels - 1u);
        let c = resize_corners(vec2(own % params.low.x, own / params.low.x), params.size, params.low);
        for (var m = 0u; m < used; m++) {
            features[m] = feature(c, m);
            presences[m] = presence(c, m);
        }
        for (var p = 0u; p < LANES; p++) {
            let at = lane * pixels + min(start + p, pixels - 1u);
            let step = LANES * pixels;
            gradients[p] = vec4(v_x[at], v_x[at + step], v_x[at + 2u * step], v_x[at + 3u * step]);
        }
        // Shares of the sources by their confidences, and the products of their outputs with the gradient.
        var shares = vec4(0.0);
        var dots = vec4(0.0);
        var top = 0.0;
        for (var m = 0u; m < select(0u, used, is_soft); m++) {
            let f = features[m];
            let present = presences[m];
            var confidence = by_error.x * present.y + by_error.y;
            var product = 0.0;
            for (var p = 0u; p < LANES; p++) {
                forward(f, p);
                let v = gradients[p];
                var sums = vec2(0.0);
                #repeat q 4
                sums += vec2(hidden[$q] * by_hidden[$q], outputs[$q] * v[$q]);
                #end
                confidence += select(0.0, total(sums.x, lane), lane == p);
                product += select(0.0, total(sums.y, lane), lane == p);
            }
            let is_there = present.x > 0.0;
            let next = select(top, max(top, confidence), is_there);
            let is_this = vec4(is_there) & (vec4(0u, 1u, 2u, 3u) == vec4(m));
            shares = select(shares * exp(top - next), vec4(present.x * exp(confidence - next)), is_this);
            dots = select(dots, vec4(product), is_this);
            top = next;
        }
        shares /= exp(-top) + shares.x + shares.y + shares.z + shares.w;
        if !is_soft {
            shares = vec4(1.0 / f32(max(used, 1u)));
        }
        let mean = dot(shares, dots);
        for (var m = 0u; m < used; m++) {
            let f = features[m];
            let is_this = vec4(0u, 1u, 2u, 3u) == vec4(m);
            let own_share = select(0.0, dot(select(vec4(0.0), shares, is_this), vec4(1.0)), inside);
            let own_dot = dot(select(vec4(0.0), dots, is_this), vec4(1.0));
            let own_confidence = select(0.0, own_share * (own_dot - mean), is_soft);
            v_by_error += own_confidence * vec2(presences[m].y, 1.0);
            var by_input = vec4(0.0);
            for (var p = 0u; p < LANES; p++) {
                forward(f, p);
                let is_positive = vec4(outputs[0], outputs[1], outputs[2], outputs[3]) > vec4(0.0);
                let v = select(vec4(0.0), subgroupShuffle(own_share, p) * gradients[p], is_positive);
                by_input = select(by_input, backward(v, subgroupShuffle(own_confidence, p), lane), lane == p);
            }
            if inside {
                v_features[m * pixels + own] = by_input;
            }
        }
    }
    let out = wid.x * (MLP_WEIGHTS + CONFIDENCE_WEIGHTS);
    #repeat q 4
    {
        let channel = 8u * $qu + lane;
        partials[out + BIAS1 + channel] = v_bias1[$q];
        partials[out + BIAS2 + channel] = v_bias2[$q];
        partials[out + MLP_WEIGHTS + channel] = v_by_hidden[$q];
        #repeat n MLP_FEATURES
        partials[out + channel * FEATURES + $nu] = v_weight1[$qu * FEATURES + $nu];
        #end
        #repeat k 32
        partials[out + WEIGHT2 + channel * HIDDEN + $ku] = v_weight2[32 * $q + $k];
        #end
    }
    #end
    let sums = vec2(total(v_by_error.x, lane), total(v_by_error.y, lane));
    if lane == 0u {
        partials[out + MLP_WEIGHTS + HIDDEN] = sums.x;
        partials[out + MLP_WEIGHTS + HIDDEN + 1u] = sums.y;
    }
}
