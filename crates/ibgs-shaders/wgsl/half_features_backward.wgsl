// residual_features_backward.wgsl on the matrix units, for the mean and the mean by confidence over the sources: gradient of the
// per-view MLP by the features and, summed over all pixels of a workgroup, by the MLP's weights.
//
// A lane is a pixel. The MLP is two products of matrices over the pixels of a subgroup: hidden = ReLU(W1 F), (outputs, confidence) =
// W2 [hidden, F], where F are the seven numbers of a source, a one, and the error of its depth; the weights of the one are the
// biases. Values pass through workgroup memory in half precision, sums in float32. Gradients are multiplied by a scale. SIDE is 16,
// LANES 32.
#import half
#import residual_feature
#import residual_mlp_layout

@group(0) @binding(0) var<storage, read> base: array<f32>;
@group(0) @binding(1) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> seen: array<u32>;
@group(0) @binding(3) var<storage, read> most_visible: array<u32>;
@group(0) @binding(4) var<storage, read> centers: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> weights: array<f32>;
// Scaled gradient by the U-Net's input, [pixel][48 / 4].
@group(0) @binding(6) var<storage, read> v_x: array<vec4<f16>>;
// (rgb, cosine) of each visible source, [visible][pixels].
@group(0) @binding(7) var<storage, read_write> v_features: array<vec4<f32>>;
// Rows of MLP_WEIGHTS and CONFIDENCE_WEIGHTS, one a workgroup.
@group(0) @binding(8) var<storage, read_write> partials: array<f32>;

const SUBGROUPS: u32 = 2u;
const THREADS: u32 = SUBGROUPS * LANES;
const QUADS: u32 = SIDE / 4u;
// Channels of F, and its places for the one and for the error of the depth.
const ONE: u32 = FEATURES;
const ERROR: u32 = FEATURES + 1u;
const F_QUADS: u32 = 4u;
// Rows of W2: the outputs, the confidence, zeros. Its columns: hidden channels, F.
const OUTPUTS: u32 = 48u;
const CONFIDENCE_AT: u32 = HIDDEN / 4u;
// Distances in workgroup memory; the padding avoids bank conflicts.
const LINE: u32 = OUTPUTS / 4u + 2u;
const HIDDEN_LINE: u32 = HIDDEN / 4u + 2u;
const F_LINE: u32 = F_QUADS + 2u;
const SUMS: u32 = OUTPUTS / 4u + 1u;
const MAX_VISIBLE: u32 = 4u;

// [output][input].
var<workgroup> w1: array<vec4<f16>, HIDDEN * F_LINE>;
var<workgroup> w2: array<vec4<f16>, OUTPUTS * LINE>;
// [source][pixel]: F.
var<workgroup> inputs: array<vec4<f16>, MAX_VISIBLE * THREADS * F_LINE>;
// [pixel]: hidden channels; gradient by the outputs and the confidence, then by the hidden channels; sums.
var<workgroup> hidden: array<vec4<f16>, THREADS * HIDDEN_LINE>;
var<workgroup> gradient: array<vec4<f16>, THREADS * LINE>;
var<workgroup> sums: array<vec4<f32>, THREADS * SUMS>;

fn weight1(o: u32, i: u32) -> f32 {
    let at = select(o * FEATURES + min(i, FEATURES - 1u), BIAS1 + o, i == ONE);
    return select(0.0, weights[at], i <= ONE);
}

fn weight2(o: u32, i: u32) -> f32 {
    let f = i - HIDDEN;
    if o < HIDDEN {
        let at = select(WEIGHT2 + o * HIDDEN + min(i, HIDDEN - 1u), BIAS2 + o, f == ONE);
        return select(0.0, weights[at], i < HIDDEN || f == ONE);
    }
    // The hidden channels, the error of the depth, the bias.
    let channel = select(select(min(i, HIDDEN - 1u), HIDDEN, f == ERROR), HIDDEN + 1u, f == ONE);
    return select(0.0, weights[CONFIDENCE_OFFSET + channel], o == HIDDEN && (i < HIDDEN || f == ERROR || f == ONE));
}

fn load_weights(local: u32) {
    for (var k = local; k < HIDDEN * F_QUADS; k += THREADS) {
        let o = k / F_QUADS;
        let i = 4u * (k % F_QUADS);
        let row = vec4(weight1(o, i), weight1(o, i + 1u), weight1(o, i + 2u), weight1(o, i + 3u));
        w1[o * F_LINE + k % F_QUADS] = to_half(row);
    }
    for (var k = local; k < OUTPUTS * OUTPUTS / 4u; k += THREADS) {
        let o = k / (OUTPUTS / 4u);
        let q = k % (OUTPUTS / 4u);
        let i = 4u * q;
        let row = vec4(weight2(o, i), weight2(o, i + 1u), weight2(o, i + 2u), weight2(o, i + 3u));
        w2[o * LINE + q] = to_half(row);
    }
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    load_weights(local);
    let pixels = params.low.x * params.low.y;
    let used = used_sources();
    let is_soft = params.aggregation == AGGREGATION_SOFT;
    let mean = 1.0 / f32(max(used, 1u));
    let z = vec4(0.0);
    // First pixel of the subgroup.
    let first = local / LANES * LANES;
    let own_hidden = local * HIDDEN_LINE;
    let own_gradient = local * LINE;
    let own_sums = local * SUMS;
    #repeat q 4
    gradient[own_gradient + CONFIDENCE_AT + $qu] = vec4<f16>();
    #end
    workgroupBarrier();
    // The weights stay in registers, as do their gradients.
    let w1_1 = SIDE * F_LINE;
    let u0 = coopLoad<MatrixB>(&w1[0], F_LINE);
    let u1 = coopLoad<MatrixB>(&w1[w1_1], F_LINE);
    #repeat o 3
    #repeat i 3
    let w2_$o$i = $ou * SIDE * LINE + $iu * QUADS;
    let w$o$i = coopLoad<MatrixB>(&w2[w2_$o$i], LINE);
    var c$o$i = MatrixC();
    #end
    #end
    var d0 = MatrixC();
    var d1 = MatrixC();
    // A subgroup reads nothing of another's pixels.
    for (var start = wid.x * THREADS; start < pixels; start += params.groups * THREADS) {
        let i = start + local;
        let inside = i < pixels;
        let at = min(i, pixels - 1u);
        let c = resize_corners(vec2(at % params.low.x, at / params.low.x), params.size, params.low);
        #repeat q 8
        let v$q = v_x[12u * at + $qu];
        #end
        // Shares of the sources by their confidences, the products of their outputs with the gradient, and which outputs are positive.
        var shares = z;
        var dots = z;
        var open = vec4(0u);
        var top = 0.0;
        for (var m = 0u; m < used; m++) {
            let own = (m * THREADS + local) * F_LINE;
            let f = feature(c, m);
            var present = vec2(0.0);
            if is_soft {
                present = presence(c, m);
            }
            inputs[own] = to_half(f.head);
            inputs[own + 1u] = to_half(f.tail);
            inputs[own + 2u] = to_half(vec4(present.y, 0.0, 0.0, 0.0));
            inputs[own + 3u] = vec4<f16>();
            subgroupBarrier();
            for (var s = first; s < first + LANES; s += SIDE) {
                let f_at = (m * THREADS + s) * F_LINE;
                let into0 = s * SUMS;
                let into1 = into0 + QUADS;
                let a = coopLoadT<MatrixA>(&inputs[f_at], F_LINE);
                coopStoreT(coopMultiplyAdd(a, u0, MatrixC()), &sums[into0], SUMS);
                coopStoreT(coopMultiplyAdd(a, u1, MatrixC()), &sums[into1], SUMS);
            }
            subgroupBarrier();
            #repeat q 8
            hidden[own_hidden + $qu] = to_half(max(sums[own_sums + $qu], z));
            #end
            subgroupBarrier();
            for (var s = first; s < first + LANES; s += SIDE) {
                let row0 = s * HIDDEN_LINE;
                let row1 = row0 + QUADS;
                let f_at = (m * THREADS + s) * F_LINE;
                let a0 = coopLoadT<MatrixA>(&hidden[row0], HIDDEN_LINE);
                let a1 = coopLoadT<MatrixA>(&hidden[row1], HIDDEN_LINE);
                let a2 = coopLoadT<MatrixA>(&inputs[f_at], F_LINE);
                #repeat o 3
                let into$o = s * SUMS + $ou * QUADS;
                let sum$o = coopMultiplyAdd(a2, w$o2, coopMultiplyAdd(a1, w$o1, coopMultiplyAdd(a0, w$o0, MatrixC())));
                coopStoreT(sum$o, &sums[into$o], SUMS);
                #end
            }
            subgroupBarrier();
            var product = 0.0;
            var bits = 0u;
            #repeat q 8
            let out$q = sums[own_sums + $qu];
            product += dot(vec4<f32>(v$q), max(out$q, z));
            bits |= dot(select(vec4(0u), vec4(1u, 2u, 4u, 8u), out$q > z), vec4(1u)) << (4u * $qu);
            #end
            open[m] = bits;
            if present.x > 0.0 {
                let confidence = sums[own_sums + CONFIDENCE_AT].x;
                let next = max(top, confidence);
                shares *= exp(top - next);
                shares[m] = present.x * exp(confidence - next);
                dots[m] = product;
                top = next;
            }
        }
        shares /= exp(-top) + shares.x + shares.y + shares.z + shares.w;
        subgroupBarrier();
        for (var m = 0u; m < used; m++) {
            for (var s = first; s < first + LANES; s += SIDE) {
                let f_at = (m * THREADS + s) * F_LINE;
                let into0 = s * SUMS;
                let into1 = into0 + QUADS;
                let a = coopLoadT<MatrixA>(&inputs[f_at], F_LINE);
                coopStoreT(coopMultiplyAdd(a, u0, MatrixC()), &sums[into0], SUMS);
                coopStoreT(coopMultiplyAdd(a, u1, MatrixC()), &sums[into1], SUMS);
            }
            subgroupBarrier();
            let share = select(0.0, select(mean, shares[m], is_soft), inside);
            let v_confidence = select(0.0, share * (dots[m] - dot(shares, dots)), is_soft);
            let bits = open[m];
            #repeat q 8
            hidden[own_hidden + $qu] = to_half(max(sums[own_sums + $qu], z));
            let passed$q = ((vec4(bits) >> vec4(4u * $qu, 4u * $qu + 1u, 4u * $qu + 2u, 4u * $qu + 3u)) & vec4(1u)) == vec4(1u);
            gradient[own_gradient + $qu] = to_half(select(z, share * vec4<f32>(v$q), passed$q));
            #end
            gradient[own_gradient + CONFIDENCE_AT] = to_half(vec4(v_confidence, 0.0, 0.0, 0.0));
            subgroupBarrier();
            for (var s = first; s < first + LANES; s += SIDE) {
                let row0 = s * LINE;
                let row1 = row0 + QUADS;
                let row2 = row1 + QUADS;
                let hidden0 = s * HIDDEN_LINE;
                let hidden1 = hidden0 + QUADS;
                let f_at = (m * THREADS + s) * F_LINE;
                // By the weights of the second layer: rows are outputs, columns inputs.
                let x0 = coopLoadT<MatrixB>(&hidden[hidden0], HIDDEN_LINE);
                let x1 = coopLoadT<MatrixB>(&hidden[hidden1], HIDDEN_LINE);
                let x2 = coopLoadT<MatrixB>(&inputs[f_at], F_LINE);
                #repeat o 3
                let g$o = coopLoad<MatrixA>(&gradient[row$o], LINE);
                #repeat i 3
                c$o$i = coopMultiplyAdd(g$o, x$i, c$o$i);
                #end
                #end
                // By the hidden channels.
                #repeat o 3
                let a$o = coopLoadT<MatrixA>(&gradient[row$o], LINE);
                #end
                #repeat n 2
                {
                    let at0 = $nu * QUADS;
                    let at1 = at0 + SIDE * LINE;
                    let at2 = at1 + SIDE * LINE;
                    let into = s * SUMS + $nu * QUADS;
                    var h = coopMultiplyAdd(a0, coopLoadT<MatrixB>(&w2[at0], LINE), MatrixC());
                    h = coopMultiplyAdd(a1, coopLoadT<MatrixB>(&w2[at1], LINE), h);
                    h = coopMultiplyAdd(a2, coopLoadT<MatrixB>(&w2[at2], LINE), h);
                    coopStoreT(h, &sums[into], SUMS);
                }
                #end
            }
            subgroupBarrier();
            #repeat q 8
            gradient[own_gradient + $qu] = to_half(select(z, sums[own_sums + $qu], hidden[own_hidden + $qu] > vec4<f16>()));
            #end
            subgroupBarrier();
            for (var s = first; s < first + LANES; s += SIDE) {
                let row0 = s * LINE;
                let row1 = row0 + QUADS;
                let f_at = (m * THREADS + s) * F_LINE;
                let into = s * SUMS;
                // By the weights of the first layer, and by F.
                let x = coopLoadT<MatrixB>(&inputs[f_at], F_LINE);
                d0 = coopMultiplyAdd(coopLoad<MatrixA>(&gradient[row0], LINE), x, d0);
                d1 = coopMultiplyAdd(coopLoad<MatrixA>(&gradient[row1], LINE), x, d1);
                var h = coopMultiplyAdd(coopLoadT<MatrixA>(&gradient[row0], LINE), coopLoadT<MatrixB>(&w1[0], F_LINE), MatrixC());
                h = coopMultiplyAdd(coopLoadT<MatrixA>(&gradient[row1], LINE), coopLoadT<MatrixB>(&w1[w1_1], F_LINE), h);
                coopStoreT(h, &sums[into], SUMS);
            }
            subgroupBarrier();
            if inside {
                v_features[m * pixels + i] = params.unscale * vec4(sums[own_sums].xyz, sums[own_sums + 1u].z);
            }
            // The next products write the sums.
            subgroupBarrier();
        }
    }
    // The sums of both subgroups, sixteen rows at a time: of the second layer's weights, then of the first's.
    let out = wid.x * (MLP_WEIGHTS + CONFIDENCE_WEIGHTS);
    let own = first * SUMS;
    let own1 = own + QUADS;
    let own2 = own + 2u * QUADS;
    #repeat o 3
    workgroupBarrier();
    coopStoreT(c$o0, &sums[own], SUMS);
    coopStoreT(c$o1, &sums[own1], SUMS);
    coopStoreT(c$o2, &sums[own2], SUMS);
    workgroupBarrier();
    for (var k = local; k < SIDE * OUTPUTS; k += THREADS) {
        let o = $ou * SIDE + k / OUTPUTS;
        put2(out, o, k % OUTPUTS, total(k / OUTPUTS, k % OUTPUTS));
    }
    #end
    #repeat o 2
    workgroupBarrier();
    coopStoreT(d$o, &sums[own], SUMS);
    workgroupBarrier();
    for (var k = local; k < SIDE * (FEATURES + 1u); k += THREADS) {
        let o = $ou * SIDE + k / (FEATURES + 1u);
        let i = k % (FEATURES + 1u);
        let into = select(o * FEATURES + i, BIAS1 + o, i == ONE);
        partials[out + into] = total(k / (FEATURES + 1u), i);
    }
    #end
}

// A sum of the workgroup's subgroups.
fn total(row: u32, column: u32) -> f32 {
    var sum = 0.0;
    for (var s = 0u; s < SUBGROUPS; s++) {
        sum += sums[(s * LANES + row) * SUMS + column / 4u][column % 4u];
    }
    return params.unscale * sum;
}

fn put2(out: u32, o: u32, i: u32, value: f32) {
    let f = i - HIDDEN;
    if o < HIDDEN {
        if i < HIDDEN {
            partials[out + WEIGHT2 + o * HIDDEN + i] = value;
        } else if f == ONE {
            partials[out + BIAS2 + o] = value;
        }
    } else if o == HIDDEN {
        if i < HIDDEN {
            partials[out + MLP_WEIGHTS + i] = value;
        } else if f == ERROR {
            partials[out + MLP_WEIGHTS + HIDDEN] = value;
        } else if f == ONE {
            partials[out + MLP_WEIGHTS + HIDDEN + 1u] = value;
        }
    }
}
