// Gradients of the 2 x 2 maximum and of the enlargement, channels last in half precision.
#import half
#import index

struct HalfResizeParams {
    // Larger and smaller size.
    size: vec2<u32>,
    source: vec2<u32>,
    // Values a pixel, divided by 4.
    quads: u32,
    pad: u32,
}

var<immediate> params: HalfResizeParams;
