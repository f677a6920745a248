// What one target view needs; the Rust twin is `ibgs_shaders::types::ViewUniforms`.
struct ViewUniforms {
    // Rows of [R | t]: x_view = R x_world + t.
    row0: vec4<f32>,
    row1: vec4<f32>,
    row2: vec4<f32>,
    focal: vec2<f32>,
    // Principal point in pixel-index coordinates (u - 0.5): the pixel with index x lies at x.
    principal: vec2<f32>,
    // Camera centre, world space.
    center: vec3<f32>,
    // Number of Gaussians.
    count: u32,
    // Image size in pixels.
    size: vec2<u32>,
    // Gaussians whose hash with the seed is smaller are left out; 0: none.
    dropout_below: u32,
    dropout_seed: u32,
    background: vec3<f32>,
    // Active spherical-harmonics degree, at most the stored one.
    sh_degree: u32,
    // Stored coefficients a channel.
    sh_coefficients: u32,
    // Length of the intersection buffers.
    capacity: u32,
    // Half side of the box that a Gaussian is cut by, in standard deviations: 3 as published; 0: none, alpha >= 1/255 everywhere.
    box_sigma: f32,
    // x/z and y/z are clamped to this many tan(half field of view) in the projection's Jacobian.
    tangent_limit: f32,
}

var<immediate> frame: ViewUniforms;

// Image size in tiles.
fn frame_tiles() -> vec2<u32> {
    return (frame.size + TILE - 1u) / TILE;
}

fn view_rotate(v: vec3<f32>) -> vec3<f32> {
    return vec3(dot(frame.row0.xyz, v), dot(frame.row1.xyz, v), dot(frame.row2.xyz, v));
}

fn view_rotate_transposed(v: vec3<f32>) -> vec3<f32> {
    return frame.row0.xyz * v.x + frame.row1.xyz * v.y + frame.row2.xyz * v.z;
}

fn view_translation() -> vec3<f32> {
    return vec3(frame.row0.w, frame.row1.w, frame.row2.w);
}
