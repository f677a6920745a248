/// An image in a photo's exposure.
struct ExposeParams {
    /// Colour behind the Gaussians.
    background: vec3<f32>,
    /// Number of pixels.
    pixels: u32,
    /// Where their transmittance begins.
    transmittance: u32,
    /// Padding.
    pad0: u32,
    /// Padding.
    pad1: u32,
    /// Padding.
    pad2: u32,
}

var<immediate> params: ExposeParams;
