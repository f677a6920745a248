// The weights of the per-view MLP in half precision in workgroup memory, as half_features_backward.wgsl multiplies with them: W1, and W2
// with the confidence behind the outputs. The kernel declares `weights`, half_mlp_pixels.wgsl THREADS.
#import half_mlp_first

// Channel of F for the error of the depth.
const ERROR: u32 = FEATURES + 1u;
const F_QUADS: u32 = 4u;
// Rows of W2: the outputs, the confidence, zeros. Its columns: hidden channels, F.
const OUTPUTS: u32 = 48u;
// Distances in workgroup memory; the padding avoids bank conflicts.
const LINE: u32 = OUTPUTS / 4u + 2u;
const F_LINE: u32 = F_QUADS + 2u;

// [output][input].
var<workgroup> w1: array<vec4<f16>, HIDDEN * F_LINE>;
var<workgroup> w2: array<vec4<f16>, OUTPUTS * LINE>;

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
        w1[o * F_LINE + k % F_QUADS] = first_weights(o, i);
    }
    for (var k = local; k < OUTPUTS * OUTPUTS / 4u; k += THREADS) {
        let o = k / (OUTPUTS / 4u);
        let q = k % (OUTPUTS / 4u);
        let i = 4u * q;
        let row = vec4(weight2(o, i), weight2(o, i + 1u), weight2(o, i + 2u), weight2(o, i + 3u));
        w2[o * LINE + q] = to_half(row);
    }
}
