// Gradients of the 2 x 2 maximum and of the enlargement, channels last in half precision.
#import half
#import index

/// Gradient of the 2 x 2 maximum or of the enlargement.
struct HalfResizeParams {
    /// The larger size.
    size: vec2<u32>,
    /// The smaller size.
    source: vec2<u32>,
    /// Values a pixel, divided by 4.
    quads: u32,
    /// Padding.
    pad: u32,
}

var<immediate> params: HalfResizeParams;
