//! As [`RESIDUAL_FEATURES_HALF`], with the per-view MLP on matrix units of 16 x 16.
#set matrix
#stage features
// The input that residual_features_half.wgsl makes, with the per-view MLP on the matrix units.
//
// A lane is a pixel. The MLP is two products of matrices over the pixels of a subgroup: hidden = ReLU(W1 F), outputs = ReLU(W2 hidden +
// biases), where F are the numbers of a source and a one. Values pass through workgroup memory in half precision, sums in
// float32, SIDE channels at a time: the less of it a subgroup needs, the more of them run at once. SIDE is 16, LANES 32.
#import half_mlp_first
#import residual_features_rest

@group(0) @binding(0) var<storage, read> base: array<f32>;
@group(0) @binding(1) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> seen: array<u32>;
@group(0) @binding(3) var<storage, read> most_visible: array<u32>;
@group(0) @binding(4) var<storage, read> centers: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> weights: array<f32>;
/// [pixel][48 / 4].
@group(0) @binding(6) var<storage, read_write> x: array<vec4<f16>>;

const THREADS: u32 = 4u * LANES;
const QUADS: u32 = SIDE / 4u;
const HIDDEN_QUADS: u32 = HIDDEN / 4u;
// Distances in workgroup memory; the padding avoids bank conflicts.
const LINE: u32 = QUADS + 2u;
const SUMS: u32 = QUADS + 1u;

// [pixel]: F, then hidden channels, then what is written; sums. Before the first pixel the weights: [output] of W1 and of each SIDE
// columns of W2.
var<workgroup> values: array<vec4<f16>, max(THREADS, 3u * HIDDEN) * LINE>;
var<workgroup> sums: array<vec4<f32>, THREADS * SUMS>;
// Biases of the outputs; the confidence's weights of the hidden channels; its weight of the error and its bias.
var<workgroup> rest: array<vec4<f32>, 2u * HIDDEN_QUADS + 1u>;

fn four(at: u32) -> vec4<f32> {
    return vec4(weights[at], weights[at + 1u], weights[at + 2u], weights[at + 3u]);
}

fn load_weights(local: u32) {
    for (var k = local; k < HIDDEN * QUADS; k += THREADS) {
        values[k / QUADS * LINE + k % QUADS] = first_weights(k / QUADS, 4u * (k % QUADS));
    }
    for (var k = local; k < HIDDEN * HIDDEN_QUADS; k += THREADS) {
        let i = k % HIDDEN_QUADS;
        let row = HIDDEN * (1u + i / QUADS) + k / HIDDEN_QUADS;
        values[row * LINE + i % QUADS] = to_half(four(WEIGHT2 + 4u * k));
    }
    for (var k = local; k < HIDDEN_QUADS; k += THREADS) {
        rest[k] = four(BIAS2 + 4u * k);
        rest[HIDDEN_QUADS + k] = four(CONFIDENCE_OFFSET + 4u * k);
    }
    if local == 0u {
        let at = CONFIDENCE_OFFSET + HIDDEN;
        rest[2u * HIDDEN_QUADS] = vec4(weights[at], weights[at + 1u], 0.0, 0.0);
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    load_weights(local);
    workgroupBarrier();
    // The weights stay in registers.
    #repeat o 2
    let first_$o = $ou * SIDE * LINE;
    let u$o = coopLoad<MatrixB>(&values[first_$o], LINE);
    #repeat i 2
    let second_$o$i = (HIDDEN * (1u + $iu) + $ou * SIDE) * LINE;
    let w$o$i = coopLoad<MatrixB>(&values[second_$o$i], LINE);
    #end
    #end
    workgroupBarrier();
    let pixels = params.low.x * params.low.y;
    let used = used_sources();
    let is_soft = params.aggregation == AGGREGATION_SOFT;
    let lane = local % LANES;
    // First pixel of the subgroup, which reads nothing of another's.
    let first = local - lane;
    let own = local * LINE;
    let own_sums = local * SUMS;
    #repeat s 2
    let row$s = (first + $su * SIDE) * LINE;
    let into$s = (first + $su * SIDE) * SUMS;
    #end
    let z = vec4(0.0);
    for (var block = wid.x * THREADS; block < pixels; block += groups.x * THREADS) {
        let at = min(block + local, pixels - 1u);
        let c = resize_corners(vec2(at % params.low.x, at / params.low.x), params.size, params.low);
        // ReLU gives no negative value: zero is the neutral one of the mean and of the largest alike.
        #repeat o 2
        #repeat q 4
        var sum$o$q = z;
        #end
        #end
        // Largest logarithm of a confidence so far and the sum of the confidences over its exponential; that of no source is 1.
        var top = 0.0;
        var total = 1.0;
        var kept = 1.0;
        var share = 1.0;
        for (var m = 0u; m < used; m++) {
            let f = feature(c, m);
            #repeat q 4
            values[own + $qu] = to_half(f.numbers[$qu]);
            #end
            subgroupBarrier();
            #repeat s 2
            let f$s = coopLoadT<MatrixA>(&values[row$s], LINE);
            #repeat o 2
            var c$s$o = MatrixC();
            #end
            #end
            var confidence = 0.0;
            #repeat i 2
            #repeat s 2
            coopStoreT(coopMultiplyAdd(f$s, u$i, MatrixC()), &sums[into$s], SUMS);
            #end
            subgroupBarrier();
            #repeat q 4
            let hidden$i$q = max(sums[own_sums + $qu], z);
            values[own + $qu] = to_half(hidden$i$q);
            confidence += dot(hidden$i$q, rest[HIDDEN_QUADS + $iu * QUADS + $qu]);
            #end
            subgroupBarrier();
            #repeat s 2
            let h$i$s = coopLoadT<MatrixA>(&values[row$s], LINE);
            #repeat o 2
            c$s$o = coopMultiplyAdd(h$i$s, w$o$i, c$s$o);
            #end
            #end
            #end
            if is_soft {
                let present = presence(c, m);
                confidence += dot(rest[2u * HIDDEN_QUADS].xy, vec2(present.y, 1.0));
                let next = select(top, max(top, confidence), present.x > 0.0);
                kept = exp(top - next);
                share = select(0.0, present.x * exp(confidence - next), present.x > 0.0);
                total = kept * total + share;
                top = next;
            }
            #repeat o 2
            subgroupBarrier();
            #repeat s 2
            coopStoreT(c$s$o, &sums[into$s], SUMS);
            #end
            subgroupBarrier();
            #repeat q 4
            sum$o$q = merge(sum$o$q, max(sums[own_sums + $qu] + rest[$ou * QUADS + $qu], z), kept, share);
            #end
            #end
        }
        let scale = merged_scale(used, total);
        #repeat o 2
        #repeat q 4
        let out$o$q = to_half(scale * sum$o$q);
        #end
        #end
        let last = ray_and_color(c);
        let out20 = to_half(last.head);
        let out21 = to_half(last.tail);
        let out22 = vec4<f16>();
        let out23 = vec4<f16>();
        // Through workgroup memory, so that neighbours write side by side.
        #repeat o 3
        subgroupBarrier();
        #repeat q 4
        values[own + $qu] = out$o$q;
        #end
        subgroupBarrier();
        for (var k = lane; k < QUADS * LANES; k += LANES) {
            let p = first + k / QUADS;
            if block + p < pixels {
                x[12u * (block + p) + $ou * QUADS + k % QUADS] = values[p * LINE + k % QUADS];
            }
        }
        #end
        subgroupBarrier();
    }
}
