/// One target view.
struct ViewUniforms {
    /// Rows of [R | t] with `x_view = R x_world + t`.
    row0: vec4<f32>,
    /// Second row.
    row1: vec4<f32>,
    /// Third row.
    row2: vec4<f32>,
    /// Focal lengths in pixels.
    focal: vec2<f32>,
    /// Principal point minus one half: the pixel with index x lies at x.
    principal: vec2<f32>,
    /// Camera centre in world space.
    center: vec3<f32>,
    /// Number of Gaussians.
    count: u32,
    /// Image size in pixels.
    size: vec2<u32>,
    /// Gaussians whose hash with the seed is smaller are left out; 0: none.
    dropout_below: u32,
    /// Seed of that hash.
    dropout_seed: u32,
    /// Background colour.
    background: vec3<f32>,
    /// Active spherical-harmonics degree, at most the stored one.
    sh_degree: u32,
    /// Stored coefficients a channel.
    sh_coefficients: u32,
    /// Length of the intersection buffers.
    capacity: u32,
    /// Half side of the box that a Gaussian is cut by, in standard deviations: 3 as published; 0: none, alpha >=
    /// 1/255 everywhere.
    box_sigma: f32,
    /// x/z and y/z are clamped to this many tan(half field of view) in the projection's Jacobian.
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
