// Windowed means of a tile for SSIM, forward. The kernel fills xs and ys with the tile and its halo, less a shift, and
// declares the buffer `moments`: nine planes, for each channel dSSIM/d(mu_x), /d(E[x x]), /d(E[x y]).
#import ssim

var<workgroup> xs: array<f32, SIDE * SIDE>;
var<workgroup> ys: array<f32, SIDE * SIDE>;
var<workgroup> mean_rows: array<f32, 5u * SIDE * TILE>;

// Moments are taken about the tile's middle photo value: E[x x] - mu mu would cancel in flat bright parts.
fn moment_shift(tile: vec2<u32>, c: u32) -> f32 {
    let middle = min(tile * TILE + TILE / 2u, params.size - 1u);
    let texel = photo[middle.y * params.size.x + middle.x];
    return select(0.5, target_channel(texel, c), target_counts(texel));
}

// Means of x, y, x x, y y, x y over the window of the thread's pixel. Every thread calls it.
fn windowed_means(lid: vec3<u32>, local: u32) -> array<f32, 5> {
    workgroupBarrier();
    for (var k = local; k < SIDE * TILE; k += TILE * TILE) {
        let base = (k / TILE) * SIDE + k % TILE;
        var s = array<f32, 5>();
        for (var i = 0u; i < 2u * RADIUS + 1u; i++) {
            let w = SSIM_WINDOW[i];
            let x = xs[base + i];
            let y = ys[base + i];
            s[0] += w * x;
            s[1] += w * y;
            s[2] += w * x * x;
            s[3] += w * y * y;
            s[4] += w * x * y;
        }
        for (var i = 0u; i < 5u; i++) {
            mean_rows[i * SIDE * TILE + k] = s[i];
        }
    }
    workgroupBarrier();
    var s = array<f32, 5>();
    for (var j = 0u; j < 2u * RADIUS + 1u; j++) {
        let w = SSIM_WINDOW[j];
        for (var i = 0u; i < 5u; i++) {
            s[i] += w * mean_rows[i * SIDE * TILE + (lid.y + j) * TILE + lid.x];
        }
    }
    return s;
}

fn store_derivatives(c: u32, p: u32, d: SsimDerivatives) {
    let plane = params.size.x * params.size.y;
    moments[(3u * c) * plane + p] = d.by_mu;
    moments[(3u * c + 1u) * plane + p] = d.by_xx;
    moments[(3u * c + 2u) * plane + p] = d.by_xy;
}
