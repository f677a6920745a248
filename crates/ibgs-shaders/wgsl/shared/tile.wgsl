// Which tiles a projected Gaussian touches. The counter and the emitter both walk `tile_rect` with `tile_hit`.

// Tiles of the box: x0, y0, x1, y1, the last two exclusive.
fn tile_rect(xy: vec2<f32>, radius: f32, tiles: vec2<u32>) -> vec4<u32> {
    let limit = vec2<f32>(tiles);
    let lo = clamp(trunc((xy - radius) / f32(TILE)), vec2(0.0), limit);
    let hi = clamp(trunc((xy + radius + f32(TILE - 1u)) / f32(TILE)), vec2(0.0), limit);
    return vec4<u32>(vec2<u32>(lo), vec2<u32>(hi));
}

// Half the Mahalanobis distance at offset d from the mean: -log(alpha / opacity).
// shape = (1 / xx, xy / xx, xx / det) of the covariance, a form without cancellation for thin Gaussians.
fn falloff(d: vec2<f32>, shape: vec3<f32>) -> f32 {
    let u = d.y - shape.y * d.x;
    return 0.5 * (d.x * d.x * shape.x + u * u * shape.z);
}

// The first row of a tile, and the one behind the last, where a Gaussian may have alpha >= 1/255; `y`: its mean from the tile's
// first row on.
fn tile_rows(y: f32, shape: vec3<f32>, opacity: f32) -> vec2<u32> {
    let variance = 1.0 / shape.z + shape.y * shape.y / shape.x;
    let reach = sqrt(2.0 * max(log(255.0 * opacity) + 0.01, 0.0) * variance);
    return vec2<u32>(clamp(vec2(floor(y - reach), ceil(y + reach) + 1.0), vec2(0.0), vec2(f32(TILE))));
}

// False only where every pixel of the tile has alpha < 1/255: the smallest falloff over the tile's pixel centres lies
// at the mean or on an edge that faces it.
fn tile_hit(tile: vec2<u32>, xy: vec2<f32>, shape: vec3<f32>, opacity: f32) -> bool {
    let cut = log(255.0 * opacity) + 0.01;
    let lo = vec2<f32>(tile * TILE) - xy;
    let hi = lo + f32(TILE - 1u);
    let facing = clamp(vec2(0.0), lo, hi);
    if all(facing == vec2(0.0)) {
        return cut > 0.0;
    }
    var best = 1e30;
    if facing.x != 0.0 {
        // Along x = const the smallest falloff is where d.y = (xy / xx) d.x.
        let y = clamp(shape.y * facing.x, lo.y, hi.y);
        best = falloff(vec2(facing.x, y), shape);
    }
    if facing.y != 0.0 {
        // d/dx of the falloff is zero at x = y m k / (1 / xx + m^2 k).
        let mk = shape.y * shape.z;
        let x = clamp(facing.y * mk / (shape.x + shape.y * mk), lo.x, hi.x);
        best = min(best, falloff(vec2(x, facing.y), shape));
    }
    return best < cut;
}
