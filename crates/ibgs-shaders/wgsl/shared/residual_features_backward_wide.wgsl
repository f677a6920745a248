// Each thread owns a 4 x 4 tile of the second layer's outer product, read from staged rows of all pixels of its workgroup.
#import residual_mlp

const THREADS: u32 = 64u;
// Vectors a staged pixel, the last one of the gradient by the logarithm of the confidence; odd, so that neighbours fall into
// different banks.
const STAGED: u32 = 17u;

var<workgroup> stage: array<vec4<f32>, THREADS * STAGED>;

fn take(channel: u32, i: u32) -> vec4<f32> {
    let plane = params.low.x * params.low.y;
    let at = channel * plane + i;
    return vec4(v_x[at], v_x[at + plane], v_x[at + 2u * plane], v_x[at + 3u * plane]);
}

fn put_stage(first: u32, v: Hidden) {
    stage[first] = v.a;
    stage[first + 1u] = v.b;
    stage[first + 2u] = v.c;
    stage[first + 3u] = v.d;
    stage[first + 4u] = v.e;
    stage[first + 5u] = v.f;
    stage[first + 6u] = v.g;
    stage[first + 7u] = v.h;
}

fn dot_row(row: u32, v: Hidden) -> f32 {
    let w = mlp_row(row);
    return dot(w.a, v.a) + dot(w.b, v.b) + dot(w.c, v.c) + dot(w.d, v.d)
        + dot(w.e, v.e) + dot(w.f, v.f) + dot(w.g, v.g) + dot(w.h, v.h);
}

// The gradient by four outputs of a source: those that are not positive receive none.
fn pick(channel: u32, i: u32, scale: f32, h: vec4<f32>) -> vec4<f32> {
    return select(vec4(0.0), scale * take(channel, i), h > vec4(0.0));
}

// Product of a source's outputs with the gradient.
fn dot_gradient(i: u32, h: Hidden) -> f32 {
    return dot(take(0u, i), h.a) + dot(take(4u, i), h.b) + dot(take(8u, i), h.c) + dot(take(12u, i), h.d)
        + dot(take(16u, i), h.e) + dot(take(20u, i), h.f) + dot(take(24u, i), h.g) + dot(take(28u, i), h.h);
}

fn put_sums(at: u32, stride: u32, v: vec4<f32>) {
    partials[at] = v.x;
    partials[at + stride] = v.y;
    partials[at + 2u * stride] = v.z;
    partials[at + 3u * stride] = v.w;
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    load_mlp(local, THREADS);
    let z = vec4(0.0);
    let pixels = params.low.x * params.low.y;
    let used = used_sources();
    let is_soft = params.aggregation == AGGREGATION_SOFT;
    let scale = 1.0 / f32(max(used, 1u));
    // Rows 4 a .. 4 a + 3 and columns 4 b .. 4 b + 3 of W2; the first layer's inputs a, a + 8 .. and outputs 4 b .. 4 b + 3.
    let a = local / 8u;
    let b = local % 8u;
    var w0 = z;
    var w1 = z;
    var w2 = z;
    var w3 = z;
    var bias2 = z;
    #repeat r MLP_ROUNDS
    var first$r = z;
    #end
    // Of the confidence: columns 4 b .. 4 b + 3 of its weights; its bias and its weight of the error.
    var by_confidence = z;
    var confidence_bias = vec2(0.0);
    let mine = local * STAGED;
    for (var start = wid.x * THREADS; start < pixels; start += params.groups * THREADS) {
        let i = start + local;
        let inside = i < pixels;
        let at = min(i, pixels - 1u);
        let c = resize_corners(vec2(at % params.low.x, at / params.low.x), params.size, params.low);
        // Shares of the sources by their confidences, and the products of their outputs with the gradient.
        var shares = z;
        var dots = z;
        var top = 0.0;
        // A first round over the sources finds the confidences.
        for (var turn = select(used, 0u, is_soft); turn < 2u * used; turn++) {
            let m = turn % used;
            let f = feature(c, m);
            var h2 = mlp_row(ROW_BIAS2);
            var present = vec2(0.0);
            var confidence = 0.0;
            if is_soft {
                present = presence(c, m);
                confidence = confidence_start(present.y);
            }
            for (var j = 0u; j < 8u; j++) {
                let hidden = mlp_hidden(j, f);
                stage[mine + 8u + j] = hidden;
                add_rows(ROW_WEIGHT2 + 4u * j, hidden, &h2);
                if is_soft {
                    confidence += dot(hidden, mlp[8u * ROW_CONFIDENCE + j]);
                }
            }
            h2 = relu(h2);
            if turn < used {
                if present.x > 0.0 {
                    let next = max(top, confidence);
                    shares *= exp(top - next);
                    shares[m] = present.x * exp(confidence - next);
                    dots[m] = dot_gradient(at, h2);
                    top = next;
                }
                if m + 1u == used {
                    shares /= exp(-top) + shares.x + shares.y + shares.z + shares.w;
                }
                continue;
            }
            let share = select(0.0, select(scale, shares[m], is_soft), inside);
            let v_confidence = select(0.0, share * (dots[m] - dot(shares, dots)), is_soft);
            let v2 = Hidden(
                pick(0u, at, share, h2.a), pick(4u, at, share, h2.b), pick(8u, at, share, h2.c), pick(12u, at, share, h2.d),
                pick(16u, at, share, h2.e), pick(20u, at, share, h2.f), pick(24u, at, share, h2.g), pick(28u, at, share, h2.h),
            );
            put_stage(mine, v2);
            stage[mine + 16u] = vec4(v_confidence, v_confidence * present.y, 0.0, 0.0);
            workgroupBarrier();
            for (var q = 0u; q < THREADS; q++) {
                let v = stage[q * STAGED + a];
                let h = stage[q * STAGED + 8u + b];
                w0 += v.x * h;
                w1 += v.y * h;
                w2 += v.z * h;
                w3 += v.w * h;
                bias2 += v;
                if is_soft {
                    let by = stage[q * STAGED + 16u].xy;
                    by_confidence += by.x * h;
                    confidence_bias += by;
                }
            }
            workgroupBarrier();
            var by_input = z;
            for (var j = 0u; j < 8u; j++) {
                let r = ROW_WEIGHT2 + 4u * j;
                let sum = vec4(dot_row(r, v2), dot_row(r + 1u, v2), dot_row(r + 2u, v2), dot_row(r + 3u, v2));
                let v_hidden = sum + v_confidence * mlp[8u * ROW_CONFIDENCE + j];
                let v = select(z, v_hidden, stage[mine + 8u + j] > z);
                by_input += vec4(dot(mlp[j], v), dot(mlp[8u + j], v), dot(mlp[16u + j], v), dot(mlp[48u + j], v));
                stage[mine + 8u + j] = v;
            }
            #repeat r MLP_ROUNDS
            stage[mine + 2u * $ru] = f.numbers[2u * $ru];
            stage[mine + 2u * $ru + 1u] = f.numbers[2u * $ru + 1u];
            #end
            workgroupBarrier();
            for (var q = 0u; q < THREADS; q++) {
                #repeat r MLP_ROUNDS
                first$r += stage[q * STAGED + 2u * $ru + a / 4u][a % 4u] * stage[q * STAGED + 8u + b];
                #end
            }
            workgroupBarrier();
            if inside {
                v_features[m * pixels + i] = by_input;
            }
        }
    }
    let out = wid.x * (MLP_WEIGHTS + CONFIDENCE_WEIGHTS);
    let row = out + WEIGHT2 + 4u * a * HIDDEN + 4u * b;
    put_sums(row, 1u, w0);
    put_sums(row + HIDDEN, 1u, w1);
    put_sums(row + 2u * HIDDEN, 1u, w2);
    put_sums(row + 3u * HIDDEN, 1u, w3);
    if b == 0u {
        put_sums(out + BIAS2 + 4u * a, 1u, bias2);
    }
    #repeat r MLP_ROUNDS
    let input$r = 8u * $ru + a;
    if input$r < FEATURES {
        put_sums(out + 4u * b * FEATURES + input$r, FEATURES, first$r);
    } else if input$r == ONE {
        put_sums(out + BIAS1 + 4u * b, 1u, first$r);
    }
    #end
    if a == 0u {
        put_sums(out + MLP_WEIGHTS + 4u * b, 1u, by_confidence);
    }
    if local == 0u {
        partials[out + MLP_WEIGHTS + HIDDEN] = confidence_bias.y;
        partials[out + MLP_WEIGHTS + HIDDEN + 1u] = confidence_bias.x;
    }
}
