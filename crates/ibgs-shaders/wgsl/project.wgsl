//! Culling, projection, colour, tile counts.
#set render
#stage project
// One thread a Gaussian: cull, project, colour, number of tiles touched (method.md section 2).
#import project

@group(0) @binding(4) var<storage, read> sh: array<f32>;

// Not clamped at 0 yet, because clamping would hide values that are not finite.
fn splat_color(i: u32, direction: vec3<f32>) -> vec3<f32> {
    let basis = sh_basis(direction, frame.sh_degree);
    var color = vec3(0.5);
    let base = i * frame.sh_coefficients * 3u;
    for (var c = 0u; c < sh_count(frame.sh_degree); c++) {
        let at = base + 3u * c;
        color += basis[c] * vec3(sh[at], sh[at + 1u], sh[at + 2u]);
    }
    return color;
}
