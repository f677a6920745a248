/// An image in a photo's exposure.
struct ExposeParams {
    /// Colour behind the Gaussians.
    background: vec3<f32>,
    /// Number of pixels.
    pixels: u32,
}

var<immediate> params: ExposeParams;
