/// Rays and planes of a target view.
struct SurfaceUniforms {
    /// Background colour.
    background: vec3<f32>,
    /// Median intersections a pixel, K: even, 2 to 8.
    intersections: u32,
    /// Focal lengths in pixels.
    focal: vec2<f32>,
    /// The ray of the pixel with index x passes through (x - principal) / focal.
    principal: vec2<f32>,
    /// Image size in pixels.
    size: vec2<u32>,
    /// Image size in tiles.
    tiles: vec2<u32>,
}

var<immediate> frame: SurfaceUniforms;

// Keeps the divisions of sections 3 and 5 finite.
const SURFACE_EPSILON: f32 = 1e-8;
// While the transmittance is above it an intersection enters the buffer `before`, then the buffer `after`.
const MEDIAN_T: f32 = 0.5;
// Entry of an intersection that is not there.
const NO_ENTRY: u32 = 0xffffffffu;

fn frame_tiles() -> vec2<u32> {
    return frame.tiles;
}

fn pixel_ray(at: vec2<f32>) -> vec3<f32> {
    return vec3((at - frame.principal) / frame.focal, 1.0);
}

// View depth at which a ray meets the plane (n_c, D_c); not positive where it does not, or only edge-on.
fn plane_depth(plane: vec4<f32>, ray: vec3<f32>) -> f32 {
    let slant = dot(plane.xyz, ray) + SURFACE_EPSILON;
    return select(0.0, -plane.w / slant, slant < -SLANT_MIN);
}
