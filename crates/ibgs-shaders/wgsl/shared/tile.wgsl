// Which tiles a projected Gaussian touches. The counter and the emitter both walk the rows of `tile_cover` with `tile_span`.

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

// Twice the falloff at a Gaussian's outline, where alpha is 1/255 or a little less; 0 where no alpha reaches that.
fn outline_cut(opacity: f32) -> f32 {
    return 2.0 * max(log(255.0 * opacity) + 0.01, 0.0);
}

// yy of the covariance, without cancellation.
fn variance_y(shape: vec3<f32>) -> f32 {
    return 1.0 / shape.z + shape.y * shape.y / shape.x;
}

// The first row of a tile, and the one behind the last, where a Gaussian may have alpha >= 1/255; `y`: its mean from the tile's
// first row on.
fn tile_rows(y: f32, shape: vec3<f32>, opacity: f32) -> vec2<u32> {
    let reach = sqrt(outline_cut(opacity) * variance_y(shape));
    return vec2<u32>(clamp(vec2(floor(y - reach), ceil(y + reach) + 1.0), vec2(0.0), vec2(f32(TILE))));
}

// Which rows of tiles a Gaussian may reach with alpha >= 1/255, and what their spans are computed from.
struct TileCover {
    // Tiles of the box: x0, y0, x1, y1, the last two exclusive; no rows where no alpha reaches 1/255.
    rect: vec4<u32>,
    xy: vec2<f32>,
    // The outline is the ellipse where alpha is 1/255. Half its height, y where it goes farthest right, and dx/dy of the line
    // through the mean that halves its rows.
    reach: f32,
    rightmost: f32,
    lean: f32,
    // Half the width of the row at height y is this times sqrt(reach^2 - y^2).
    width: f32,
}

// `box`: the tiles of the Gaussian's box.
fn tile_cover(box: vec4<u32>, xy: vec2<f32>, shape: vec3<f32>, opacity: f32) -> TileCover {
    let cut = outline_cut(opacity);
    let yy = variance_y(shape);
    let reach = sqrt(cut * yy);
    var rect = box;
    // A row of tiles is reached where its pixel centres, from 16 y to 16 y + 15, are.
    let rows = vec2(ceil((xy.y - reach - f32(TILE - 1u)) / f32(TILE)), floor((xy.y + reach) / f32(TILE)) + 1.0);
    let limited = vec2<u32>(clamp(rows, vec2(f32(rect.y)), vec2(f32(rect.w))));
    rect.y = limited.x;
    rect.w = select(limited.x, limited.y, cut > 0.0);
    let width = inverseSqrt(shape.x * shape.z) / yy;
    return TileCover(rect, xy, reach, shape.y * sqrt(cut / shape.x), shape.y / (shape.x * yy), width);
}

// First tile of a row, and the one behind the last, with a pixel of alpha >= 1/255. The outline's part between the row's first
// and last pixel centres goes farthest right at its rightmost point or, where that lies elsewhere, at the nearer end; left
// likewise, as the outline is symmetric about the mean.
fn tile_span(row: u32, cover: TileCover) -> vec2<u32> {
    let lo = f32(row * TILE) - cover.xy.y;
    let ends = clamp(vec2(-cover.rightmost, cover.rightmost), vec2(lo), vec2(lo + f32(TILE - 1u)));
    let inside = (cover.reach - ends) * (cover.reach + ends);
    if any(inside < vec2(0.0)) {
        return vec2(cover.rect.x);
    }
    let reach = cover.xy.x + cover.lean * ends + vec2(-cover.width, cover.width) * sqrt(inside);
    let first = ceil((reach.x - f32(TILE - 1u)) / f32(TILE));
    let behind = floor(reach.y / f32(TILE)) + 1.0;
    let span = vec2<u32>(clamp(vec2(first, behind), vec2(f32(cover.rect.x)), vec2(f32(cover.rect.z))));
    return vec2(span.x, max(span.x, span.y));
}
