// How the residual network's output becomes the final colour.
#import seen

/// The final colour.
struct ComposeParams {
    /// Image size in pixels.
    size: vec2<u32>,
    /// Size at which the network ran.
    low: vec2<u32>,
    /// Factor of the base colour where the output is reached (burn-in).
    gain: f32,
    /// An [`crate::Output`].
    output: u32,
    /// 1: pixels that see no source have the base colour.
    seen_only: u32,
    /// Visible sources a pixel, V.
    visible: u32,
}

var<immediate> params: ComposeParams;

// Whether the network's output counts at a pixel, given that some pixel of the image sees a source.
fn is_reached(packed: u32) -> bool {
    return params.seen_only == 0u || is_seen(packed, 0u);
}
