// Gradient of the projection of `gaussian`.

struct EwaGradient {
    // By the mean in view space.
    view: vec3<f32>,
    // By axes diag(scale), in columns.
    spread: mat3x3<f32>,
    // By the focal lengths.
    focal: vec2<f32>,
}

// `by_xy` and `by_cov`: gradients by the projected mean and covariance in pixels.
fn ewa_backward(
    e: Ewa,
    view: vec3<f32>,
    axes: mat3x3<f32>,
    scale: vec3<f32>,
    by_xy: vec2<f32>,
    by_cov: vec3<f32>,
) -> EwaGradient {
    // cov = M M^T with M = J axes diag(scale).
    let v_m0 = 2.0 * by_cov.x * e.m0 + by_cov.y * e.m1;
    let v_m1 = 2.0 * by_cov.z * e.m1 + by_cov.y * e.m0;
    let inv_z = 1.0 / view.z;
    let f = frame.focal * inv_z;
    let j0 = vec3(f.x, 0.0, -f.x * e.tangent.x);
    let j1 = vec3(0.0, f.y, -f.y * e.tangent.y);
    var v: EwaGradient;
    var v_j0 = vec3(0.0);
    var v_j1 = vec3(0.0);
    for (var c = 0u; c < 3u; c++) {
        v.spread[c] = j0 * v_m0[c] + j1 * v_m1[c];
        v_j0 += v_m0[c] * axes[c] * scale[c];
        v_j1 += v_m1[c] * axes[c] * scale[c];
    }
    let v_tangent = -f * vec2(v_j0.z, v_j1.z) * e.free;
    let v_inv_z = frame.focal.x * (v_j0.x - e.tangent.x * v_j0.z) + frame.focal.y * (v_j1.y - e.tangent.y * v_j1.z);
    // x / z and y / z: of the projected mean and of the Jacobian.
    let v_ratio = frame.focal * by_xy + v_tangent;
    v.view = vec3(v_ratio * inv_z, -inv_z * (dot(v_ratio, view.xy * inv_z) + v_inv_z * inv_z));
    // Where x / z is clamped its product with the focal length is a constant.
    v.focal = inv_z * (by_xy * view.xy + vec2(v_j0.x, v_j1.y) - e.free * e.tangent * vec2(v_j0.z, v_j1.z));
    return v;
}
