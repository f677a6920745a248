// The kernel declares `params: SourceParams`.

/// One source view beside a target view.
struct SourceParams {
    /// Rows of [R | t] that take the target's view space to the source's.
    row0: vec4<f32>,
    /// Second row.
    row1: vec4<f32>,
    /// Third row.
    row2: vec4<f32>,
    /// The target's focal lengths in pixels.
    focal: vec2<f32>,
    /// The target's principal point, as in [`SurfaceUniforms`].
    principal: vec2<f32>,
    /// The source's focal lengths in pixels.
    source_focal: vec2<f32>,
    /// The source's principal point: its texel with index x lies at x.
    source_principal: vec2<f32>,
    /// The target's size in pixels.
    size: vec2<u32>,
    /// The source's size in pixels.
    source_size: vec2<u32>,
    /// Number of the source among the target's sources.
    index: u32,
    /// Visible sources a pixel, V.
    visible: u32,
    /// Median intersections a pixel.
    intersections: u32,
    /// Unused.
    pad0: u32,
}

const SOURCE_EPSILON: f32 = 1e-8;

struct Landing {
    // All four texels of the bilinear read exist.
    inside: bool,
    // Top left texel, and the position between the texel centres.
    texel: u32,
    fraction: vec2<f32>,
    // View depth in the source, and d(texel coordinates)/d(depth in the target).
    depth: f32,
    slope: vec2<f32>,
}

// The pixel's ray in the source's view space: what it moves by for one unit of depth in the target.
fn source_ray(pixel: vec2<u32>) -> vec3<f32> {
    let ray = vec3((vec2<f32>(pixel) - params.principal) / params.focal, 1.0);
    return vec3(dot(params.row0.xyz, ray), dot(params.row1.xyz, ray), dot(params.row2.xyz, ray));
}

fn source_point(ray: vec3<f32>, z: f32) -> vec3<f32> {
    return ray * z + vec3(params.row0.w, params.row1.w, params.row2.w);
}

fn land(ray: vec3<f32>, z: f32) -> Landing {
    var l: Landing;
    let point = source_point(ray, z);
    let ratio = point.xy / point.z;
    let at = params.source_focal * ratio + params.source_principal;
    let last = vec2<f32>(params.source_size) - 1.0;
    l.inside = point.z > 0.0 && all(at >= vec2(0.0)) && all(at <= last) && all(last >= vec2(1.0));
    if l.inside {
        // On the far edge the last pair of texels is read with a fraction of one.
        let first = min(vec2<u32>(at), params.source_size - 2u);
        l.texel = first.y * params.source_size.x + first.x;
        l.fraction = at - vec2<f32>(first);
        l.depth = point.z;
        l.slope = params.source_focal * (ray.xy - ratio * ray.z) / point.z;
    }
    return l;
}

fn bilinear_weights(fraction: vec2<f32>) -> vec4<f32> {
    let rest = 1.0 - fraction;
    return vec4(rest.x * rest.y, fraction.x * rest.y, rest.x * fraction.y, fraction.x * fraction.y);
}

// Cosine of the angle between the rays of target and source to a point, and its derivative by the depth in the target.
fn ray_cosine(ray: vec3<f32>, z: f32) -> vec2<f32> {
    let point = source_point(ray, z);
    let from_target = ray * z;
    let a = from_target / (length(from_target) + SOURCE_EPSILON);
    let distance = length(point) + SOURCE_EPSILON;
    let b = point / distance;
    let sine = cross(a, b);
    return vec2(dot(a, b), dot(sine, sine) * length(ray) / distance);
}
