// Windowed means of a tile for SSIM, forward. The kernel fills `values` with (x, y) of the tile and its halo, less a shift, and
// declares the buffer `moments`: nine planes, for each channel dSSIM/d(mu_x), /d(E[x x]), /d(E[x y]).
#import ssim

var<workgroup> values: array<vec2<f32>, SIDE * SIDE>;
// Sums along the rows, as in `Means`.
var<workgroup> own_rows: array<vec4<f32>, SIDE * TILE>;
var<workgroup> xy_rows: array<f32, SIDE * TILE>;

// Moments are taken about the tile's middle photo value: E[x x] - mu mu would cancel in flat bright parts.
fn moment_shift(tile: vec2<u32>, c: u32) -> f32 {
    let middle = min(tile * TILE + TILE / 2u, params.size - 1u);
    let texel = photo[middle.y * params.size.x + middle.x];
    return select(0.5, target_channel(texel, c), target_counts(texel));
}

// The means over the window of the thread's pixel. Every thread calls it.
fn windowed_means(lid: vec3<u32>, local: u32) -> Means {
    workgroupBarrier();
    for (var k = local; k < SIDE * TILE; k += TILE * TILE) {
        let base = (k / TILE) * SIDE + k % TILE;
        var s = Means(vec4(0.0), 0.0);
        #repeat i 11
        let v$i = values[base + $iu];
        let weighed$i = SSIM_WINDOW[$i] * v$i;
        s.own += vec4(weighed$i, weighed$i * v$i);
        s.xy += weighed$i.x * v$i.y;
        #end
        own_rows[k] = s.own;
        xy_rows[k] = s.xy;
    }
    workgroupBarrier();
    var s = Means(vec4(0.0), 0.0);
    let at = lid.y * TILE + lid.x;
    #repeat j 11
    s.own += SSIM_WINDOW[$j] * own_rows[at + $ju * TILE];
    s.xy += SSIM_WINDOW[$j] * xy_rows[at + $ju * TILE];
    #end
    return s;
}

fn store_derivatives(c: u32, p: u32, d: SsimDerivatives) {
    let plane = params.size.x * params.size.y;
    moments[(3u * c) * plane + p] = d.by_mu;
    moments[(3u * c + 1u) * plane + p] = d.by_xx;
    moments[(3u * c + 2u) * plane + p] = d.by_xy;
}
