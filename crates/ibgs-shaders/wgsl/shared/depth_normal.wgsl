// The depth normal Nd = normalise((P_right - P_left) x (P_top - P_bottom)) of method.md section 3, where P = z r is a
// back-projected median depth. With p = (z_r - z_l) / (z_r + z_l) and q = (z_t - z_b) / (z_t + z_b) the cross
// product is
//     (z_r + z_l) (z_t + z_b) / (fx fy) * m,    m = (fx p, -fy q, -1 - (x - cx) p + (y - cy) q),
// so Nd = m / |m|. Written so there is no difference of nearly equal points, and since m . r_center = -1 the normal
// always faces the camera. The kernel declares `depth`.

/// The normal loss.
struct SurfaceParams {
    /// Image size in pixels.
    size: vec2<u32>,
    /// Focal lengths in pixels.
    focal: vec2<f32>,
    /// Principal point minus one half: the pixel with index x lies at x.
    principal: vec2<f32>,
    /// Weight of the loss.
    weight: f32,
    /// Padding.
    pad: f32,
}

var<immediate> params: SurfaceParams;

struct DepthNormal {
    // Nd; zero on the border and where a pair of neighbours has no depth.
    normal: vec3<f32>,
    // 1 / |m|, 0 where there is no normal.
    inverse: f32,
    // z_r + z_l and z_t + z_b.
    sums: vec2<f32>,
}

fn depth_normal(at: vec2<u32>) -> DepthNormal {
    if any(at == vec2(0u)) || any(at + 1u >= params.size) {
        return DepthNormal(vec3(0.0), 0.0, vec2(0.0));
    }
    let p = at.y * params.size.x + at.x;
    let first = vec2(depth[p + 1u], depth[p - params.size.x]);
    let second = vec2(depth[p - 1u], depth[p + params.size.x]);
    let sums = first + second;
    // Depths are positive, or 0 where nothing was met.
    if !(sums.x > 0.0 && sums.y > 0.0) {
        return DepthNormal(vec3(0.0), 0.0, vec2(0.0));
    }
    let slope = (first - second) / sums;
    let offset = vec2<f32>(at) - params.principal;
    let m = vec3(params.focal.x * slope.x, -params.focal.y * slope.y, offset.y * slope.y - offset.x * slope.x - 1.0);
    let inverse = inverseSqrt(dot(m, m));
    return DepthNormal(m * inverse, inverse, sums);
}
