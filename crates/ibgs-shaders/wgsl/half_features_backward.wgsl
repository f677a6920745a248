//! Gradient of the per-view MLP, rows of weight gradients.
#set matrix
#stage features backward
// residual_features_backward.wgsl on the matrix units: gradient of the per-view MLP by the features and, summed over all pixels of
// a workgroup, by the MLP's weights.
//
// A lane is a pixel. Gradients are multiplied by a scale. SIDE is 16, LANES 32.
#import half_mlp_pixels
#import half_mlp_rows

@group(0) @binding(0) var<storage, read> base: array<f32>;
@group(0) @binding(1) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> seen: array<u32>;
@group(0) @binding(3) var<storage, read> most_visible: array<u32>;
@group(0) @binding(4) var<storage, read> centers: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> weights: array<f32>;
/// Scaled gradient by the U-Net's input, [pixel][48 / 4].
@group(0) @binding(6) var<storage, read> v_x: array<vec4<f16>>;
/// (rgb, cosine) of each visible source, [visible][pixels].
@group(0) @binding(7) var<storage, read_write> v_features: array<vec4<f32>>;
/// Rows of MLP_WEIGHTS and CONFIDENCE_WEIGHTS, one a workgroup.
@group(0) @binding(8) var<storage, read_write> partials: array<f32>;

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
    #repeat o 2
    let w1_$o = $ou * SIDE * F_LINE;
    let u$o = coopLoad<MatrixB>(&w1[w1_$o], F_LINE);
    #end
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
        #repeat o 2
        #repeat q 4
        let v$o$q = v_x[12u * at + $ou * QUADS + $qu];
        #end
        #end
        // Shares of the sources by their confidences, the products of their outputs with the gradient, and which outputs are positive.
        var shares = z;
        var dots = z;
        var open = vec4(0u);
        var top = 0.0;
        for (var m = 0u; m < used; m++) {
            var present = vec2(0.0);
            if is_soft {
                present = presence(c, m);
            }
            put_inputs(local, feature(c, m), present.y);
            subgroupBarrier();
            #repeat o 2
            for (var s = first; s < first + LANES; s += SIDE) {
                let f_at = s * F_LINE;
                let into = s * SUMS;
                coopStoreT(coopMultiplyAdd(coopLoadT<MatrixA>(&inputs[f_at], F_LINE), u$o, MatrixC()), &sums[into], SUMS);
            }
            subgroupBarrier();
            #repeat q 4
            hidden[own_hidden + $ou * QUADS + $qu] = to_half(max(sums[own_sums + $qu], z));
            #end
            subgroupBarrier();
            #end
            var product = 0.0;
            var bits = 0u;
            var confidence = 0.0;
            #repeat o 2
            for (var s = first; s < first + LANES; s += SIDE) {
                let row0 = s * HIDDEN_LINE;
                let row1 = row0 + QUADS;
                let row2 = s * F_LINE;
                let into = s * SUMS;
                var sum = coopMultiplyAdd(coopLoadT<MatrixA>(&hidden[row0], HIDDEN_LINE), w$o0, MatrixC());
                sum = coopMultiplyAdd(coopLoadT<MatrixA>(&hidden[row1], HIDDEN_LINE), w$o1, sum);
                sum = coopMultiplyAdd(coopLoadT<MatrixA>(&inputs[row2], F_LINE), w$o2, sum);
                coopStoreT(sum, &sums[into], SUMS);
            }
            subgroupBarrier();
            #repeat q 4
            let out$o$q = sums[own_sums + $qu];
            product += dot(vec4<f32>(v$o$q), max(out$o$q, z));
            bits |= dot(select(vec4(0u), vec4(1u, 2u, 4u, 8u), out$o$q > z), vec4(1u)) << (16u * $ou + 4u * $qu);
            #end
            subgroupBarrier();
            #end
            if is_soft {
                for (var s = first; s < first + LANES; s += SIDE) {
                    let row0 = s * HIDDEN_LINE;
                    let row1 = row0 + QUADS;
                    let row2 = s * F_LINE;
                    let into = s * SUMS;
                    var sum = coopMultiplyAdd(coopLoadT<MatrixA>(&hidden[row0], HIDDEN_LINE), w20, MatrixC());
                    sum = coopMultiplyAdd(coopLoadT<MatrixA>(&hidden[row1], HIDDEN_LINE), w21, sum);
                    sum = coopMultiplyAdd(coopLoadT<MatrixA>(&inputs[row2], F_LINE), w22, sum);
                    coopStoreT(sum, &sums[into], SUMS);
                }
                subgroupBarrier();
                confidence = sums[own_sums].x;
                subgroupBarrier();
            }
            open[m] = bits;
            if present.x > 0.0 {
                let next = max(top, confidence);
                shares *= exp(top - next);
                shares[m] = present.x * exp(confidence - next);
                dots[m] = product;
                top = next;
            }
        }
        shares /= exp(-top) + shares.x + shares.y + shares.z + shares.w;
        for (var m = 0u; m < used; m++) {
            var error = 0.0;
            if is_soft {
                error = presence(c, m).y;
            }
            put_inputs(local, feature(c, m), error);
            subgroupBarrier();
            #repeat o 2
            for (var s = first; s < first + LANES; s += SIDE) {
                let f_at = s * F_LINE;
                let into = s * SUMS;
                coopStoreT(coopMultiplyAdd(coopLoadT<MatrixA>(&inputs[f_at], F_LINE), u$o, MatrixC()), &sums[into], SUMS);
            }
            subgroupBarrier();
            #repeat q 4
            hidden[own_hidden + $ou * QUADS + $qu] = to_half(max(sums[own_sums + $qu], z));
            #end
            subgroupBarrier();
            #end
            let share = select(0.0, select(mean, shares[m], is_soft), inside);
            let v_confidence = select(0.0, share * (dots[m] - dot(shares, dots)), is_soft);
            let bits = open[m];
            #repeat o 2
            #repeat q 4
            let passed$o$q = (vec4(bits) >> (16u * $ou + 4u * $qu + vec4(0u, 1u, 2u, 3u))) & vec4(1u);
            let v_out$o$q = select(z, share * vec4<f32>(v$o$q), passed$o$q == vec4(1u));
            gradient[own_gradient + $ou * QUADS + $qu] = to_half(v_out$o$q);
            #end
            #end
            gradient[own_gradient + CONFIDENCE_AT] = to_half(vec4(v_confidence, 0.0, 0.0, 0.0));
            subgroupBarrier();
            // By the weights of the second layer: rows are outputs, columns inputs.
            for (var s = first; s < first + LANES; s += SIDE) {
                let hidden0 = s * HIDDEN_LINE;
                let hidden1 = hidden0 + QUADS;
                let f_at = s * F_LINE;
                let x0 = coopLoadT<MatrixB>(&hidden[hidden0], HIDDEN_LINE);
                let x1 = coopLoadT<MatrixB>(&hidden[hidden1], HIDDEN_LINE);
                let x2 = coopLoadT<MatrixB>(&inputs[f_at], F_LINE);
                #repeat o 3
                let row$o = s * LINE + $ou * QUADS;
                let g$o = coopLoad<MatrixA>(&gradient[row$o], LINE);
                #repeat i 3
                c$o$i = coopMultiplyAdd(g$o, x$i, c$o$i);
                #end
                #end
            }
            // By the hidden channels, whose place it takes.
            #repeat n 2
            for (var s = first; s < first + LANES; s += SIDE) {
                let into = s * SUMS;
                var h = MatrixC();
                #repeat o 3
                let row$o = s * LINE + $ou * QUADS;
                let b$o = $ou * SIDE * LINE + $nu * QUADS;
                h = coopMultiplyAdd(coopLoadT<MatrixA>(&gradient[row$o], LINE), coopLoadT<MatrixB>(&w2[b$o], LINE), h);
                #end
                coopStoreT(h, &sums[into], SUMS);
            }
            subgroupBarrier();
            #repeat q 4
            {
                let own = own_hidden + $nu * QUADS + $qu;
                hidden[own] = to_half(select(z, sums[own_sums + $qu], hidden[own] > vec4<f16>()));
            }
            #end
            subgroupBarrier();
            #end
            for (var s = first; s < first + LANES; s += SIDE) {
                let row0 = s * HIDDEN_LINE;
                let row1 = row0 + QUADS;
                let f_at = s * F_LINE;
                let into = s * SUMS;
                // By the weights of the first layer, and by F.
                let x = coopLoadT<MatrixB>(&inputs[f_at], F_LINE);
                d0 = coopMultiplyAdd(coopLoad<MatrixA>(&hidden[row0], HIDDEN_LINE), x, d0);
                d1 = coopMultiplyAdd(coopLoad<MatrixA>(&hidden[row1], HIDDEN_LINE), x, d1);
                var h = coopMultiplyAdd(coopLoadT<MatrixA>(&hidden[row0], HIDDEN_LINE), coopLoadT<MatrixB>(&w1[w1_0], F_LINE), MatrixC());
                h = coopMultiplyAdd(coopLoadT<MatrixA>(&hidden[row1], HIDDEN_LINE), coopLoadT<MatrixB>(&w1[w1_1], F_LINE), h);
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
    // The sums of all subgroups, a matrix at a time: of the second layer's weights, then of the first's.
    let out = wid.x * (MLP_WEIGHTS + CONFIDENCE_WEIGHTS);
    let own = first * SUMS;
    #repeat o 3
    #repeat i 3
    workgroupBarrier();
    coopStoreT(c$o$i, &sums[own], SUMS);
    workgroupBarrier();
    for (var k = local; k < SIDE * SIDE; k += THREADS) {
        put2(out, $ou * SIDE + k / SIDE, $iu * SIDE + k % SIDE, total(k / SIDE, k % SIDE));
    }
    #end
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
