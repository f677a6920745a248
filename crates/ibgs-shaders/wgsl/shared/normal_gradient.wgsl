// Gradients of the normal loss at a pixel. The kernel imports `depth_normal` and `photo` and declares `normal`, `photo` and `v_loss`.

fn normal_at(at: vec2<u32>) -> vec3<f32> {
    let p = 3u * (at.y * params.size.x + at.x);
    return vec3(normal[p], normal[p + 1u], normal[p + 2u]);
}

fn scale() -> f32 {
    return v_loss[0] * params.weight / f32(params.size.x * params.size.y);
}

// By m of shared/depth_normal.wgsl; zero where the loss does not count.
fn cross_gradient(at: vec2<u32>, nd: DepthNormal) -> vec3<f32> {
    if nd.inverse == 0.0 || !photo_valid(photo[at.y * params.size.x + at.x]) {
        return vec3(0.0);
    }
    let n = normal_at(at);
    let v_nd = scale() * (NORMAL_L1 * sign(nd.normal - n) - NORMAL_DOT * n);
    return (v_nd - nd.normal * dot(nd.normal, v_nd)) * nd.inverse;
}
