// The first layer of the per-view MLP in half precision. The kernel declares `weights`.
#import half
#import residual_mlp_layout

fn weight1(o: u32, i: u32) -> f32 {
    let at = select(o * FEATURES + min(i, FEATURES - 1u), BIAS1 + o, i == ONE);
    return select(0.0, weights[at], i <= ONE);
}

// Weights of output o by the inputs i .. i + 3.
fn first_weights(o: u32, i: u32) -> vec4<f16> {
    return to_half(vec4(weight1(o, i), weight1(o, i + 1u), weight1(o, i + 2u), weight1(o, i + 3u)));
}
