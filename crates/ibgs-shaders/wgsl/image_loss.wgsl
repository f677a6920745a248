// One workgroup a tile and channel: |x - y|, SSIM, and the derivatives of SSIM by its windowed moments.
#import ssim

@group(0) @binding(0) var<storage, read> image: array<f32>;
@group(0) @binding(1) var<storage, read> photo: array<u32>;
// Nine planes: for each channel dSSIM/d(mu_x), /d(E[x x]), /d(E[x y]).
@group(0) @binding(2) var<storage, read_write> moments: array<f32>;
// (sum |x - y|, sum SSIM, sum of squared errors of the clamped image, 0) of each workgroup.
@group(0) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;

var<workgroup> xs: array<f32, SIDE * SIDE>;
var<workgroup> ys: array<f32, SIDE * SIDE>;
var<workgroup> rows: array<f32, 5u * SIDE * TILE>;
var<workgroup> sums: array<vec4<f32>, TILE * TILE>;

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_id) lid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let c = wid.z;
    // Moments are taken about the tile's middle photo value: E[x x] - mu mu would cancel in flat bright parts.
    let middle = min(wid.xy * TILE + TILE / 2u, params.size - 1u);
    let middle_texel = photo[middle.y * params.size.x + middle.x];
    let shift = select(0.5, photo_channel(middle_texel, c), photo_valid(middle_texel));
    for (var k = local; k < SIDE * SIDE; k += TILE * TILE) {
        let p = halo_pixel(wid.xy, k);
        var x = 0.0;
        var y = 0.0;
        if p >= 0 {
            x = image[3u * u32(p) + c];
            let texel = photo[p];
            y = select(x, photo_channel(texel, c), photo_valid(texel));
        }
        xs[k] = x - shift;
        ys[k] = y - shift;
    }
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
            rows[i * SIDE * TILE + k] = s[i];
        }
    }
    workgroupBarrier();
    var s = array<f32, 5>();
    for (var j = 0u; j < 2u * RADIUS + 1u; j++) {
        let w = SSIM_WINDOW[j];
        for (var i = 0u; i < 5u; i++) {
            s[i] += w * rows[i * SIDE * TILE + (lid.y + j) * TILE + lid.x];
        }
    }
    var result = vec4(0.0);
    let pixel = wid.xy * TILE + lid.xy;
    if all(pixel < params.size) {
        let derivatives = ssim_derivatives(s, shift);
        let p = pixel.y * params.size.x + pixel.x;
        let plane = params.size.x * params.size.y;
        moments[(3u * c) * plane + p] = derivatives.by_mu;
        moments[(3u * c + 1u) * plane + p] = derivatives.by_xx;
        moments[(3u * c + 2u) * plane + p] = derivatives.by_xy;
        let at = (lid.y + RADIUS) * SIDE + lid.x + RADIUS;
        let error = clamp(xs[at] + shift, 0.0, 1.0) - clamp(ys[at] + shift, 0.0, 1.0);
        result = vec4(abs(xs[at] - ys[at]), derivatives.ssim, error * error, 0.0);
    }
    sums[local] = result;
    workgroupBarrier();
    for (var step = TILE * TILE / 2u; step > 0u; step >>= 1u) {
        if local < step {
            sums[local] += sums[local + step];
        }
        workgroupBarrier();
    }
    if local == 0u {
        partials[(wid.z * params.tiles.y + wid.y) * params.tiles.x + wid.x] = sums[0];
    }
}
