// How the residual network's output becomes the final colour.
#import resize

struct ComposeParams {
    size: vec2<u32>,
    // Size at which the network ran.
    low: vec2<u32>,
    // Factor of the base colour (burn-in).
    gain: f32,
    // 1: the network gives the colour itself.
    full_color: u32,
}

var<immediate> params: ComposeParams;

// Factor of the base colour; where no source is seen at all there is no network output.
fn base_share(used: bool) -> f32 {
    return select(params.gain, select(1.0, 0.0, used), params.full_color == 1u);
}
