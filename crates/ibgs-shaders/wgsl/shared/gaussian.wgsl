// Covariance of a Gaussian and its EWA projection (method.md section 2).
#import quaternion

struct Ewa {
    // Projected mean, pixel-index coordinates.
    xy: vec2<f32>,
    // Covariance in pixels: xx, xy, yy, with the 0.3 added to the diagonal.
    cov: vec3<f32>,
    // Its determinant, by Lagrange's identity: no cancellation for thin Gaussians.
    det: f32,
    // x/z and y/z clamped, and whether each was left alone (1) or clamped (0).
    tangent: vec2<f32>,
    free: vec2<f32>,
    // Rows of J R Rq S.
    m0: vec3<f32>,
    m1: vec3<f32>,
}

// `view`: mean in view space; `axes`: columns of R Rq; `scale`: activated scales.
fn ewa_project(view: vec3<f32>, axes: mat3x3<f32>, scale: vec3<f32>) -> Ewa {
    var e: Ewa;
    let inv_z = 1.0 / view.z;
    let raw = view.xy * inv_z;
    let limit = frame.tangent_limit * 0.5 * vec2<f32>(frame.size) / frame.focal;
    e.tangent = clamp(raw, -limit, limit);
    e.free = select(vec2(0.0), vec2(1.0), e.tangent == raw);
    e.xy = frame.focal * raw + frame.principal;
    let j0 = vec3(frame.focal.x, 0.0, -frame.focal.x * e.tangent.x) * inv_z;
    let j1 = vec3(0.0, frame.focal.y, -frame.focal.y * e.tangent.y) * inv_z;
    e.m0 = (j0 * axes) * scale;
    e.m1 = (j1 * axes) * scale;
    let xx = dot(e.m0, e.m0);
    let yy = dot(e.m1, e.m1);
    e.cov = vec3(xx + COV_BLUR, dot(e.m0, e.m1), yy + COV_BLUR);
    let c = cross(e.m0, e.m1);
    e.det = dot(c, c) + COV_BLUR * (xx + yy) + COV_BLUR * COV_BLUR;
    return e;
}

// Radius on the screen in whole pixels, from the larger eigenvalue: half the side of the box where there is one, else 3 standard
// deviations.
fn splat_radius(cov: vec3<f32>, det: f32) -> f32 {
    let mid = 0.5 * (cov.x + cov.z);
    let sigmas = select(3.0, frame.box_sigma, frame.box_sigma > 0.0);
    return ceil(sigmas * sqrt(mid + sqrt(max(0.1, mid * mid - det))));
}

// True for infinities and NaN, by bits: compilers may assume that floats are finite.
fn not_finite(v: f32) -> bool {
    return (bitcast<u32>(v) & 0x7f800000u) == 0x7f800000u;
}

fn not_finite3(v: vec3<f32>) -> bool {
    return not_finite(v.x) || not_finite(v.y) || not_finite(v.z);
}

fn is_nan(v: f32) -> bool {
    return (bitcast<u32>(v) & 0x7fffffffu) > 0x7f800000u;
}
