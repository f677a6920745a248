// Which pixels the normal loss compares, and the normal of the normal map there (method.md section 7). Departs from the published
// code where `params.bend` is above 0: then a pixel counts only on a smooth part of a surface. Its transmittance and its
// neighbours' is at most one half, so that their median depths lie on a surface and not in what fog or a soft edge leaves; and
// along rows and columns the depth turns by at most `bend` pixel widths, so that no depth normal joins two sides of an edge. The
// normal map is compared by direction: its length is how much of the pixel is covered, which normals should not decide. The kernel
// declares `depth`, `normal`, `photo` and `transmittance`.
#import depth_normal
#import photo

struct MapNormal {
    direction: vec3<f32>,
    // 1 / its length in the map; 0 where that is compared too.
    inverse: f32,
}

fn map_normal(p: u32) -> MapNormal {
    let n = vec3(normal[3u * p], normal[3u * p + 1u], normal[3u * p + 2u]);
    if params.bend == 0.0 {
        return MapNormal(n, 0.0);
    }
    let inverse = inverseSqrt(max(dot(n, n), 1e-12));
    return MapNormal(n * inverse, inverse);
}

fn is_smooth(at: vec2<u32>) -> bool {
    if any(at == vec2(0u)) || any(at + 1u >= params.size) {
        return false;
    }
    let p = at.y * params.size.x + at.x;
    let around = vec4(p + 1u, p - 1u, p - params.size.x, p + params.size.x);
    let open = vec4(
        transmittance[around.x], transmittance[around.y], transmittance[around.z], transmittance[around.w],
    );
    if max(transmittance[p], max(max(open.x, open.y), max(open.z, open.w))) > 0.5 {
        return false;
    }
    let z = depth[p];
    let turn = vec2(depth[around.x] + depth[around.y], depth[around.z] + depth[around.w]) - 2.0 * z;
    return all(abs(turn) * params.focal <= vec2(params.bend * z));
}

fn is_compared(at: vec2<u32>) -> bool {
    if !photo_valid(photo[at.y * params.size.x + at.x]) {
        return false;
    }
    return params.bend == 0.0 || is_smooth(at);
}
