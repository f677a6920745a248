// One workgroup a tile and channel: |x - y|, SSIM, and the derivatives of SSIM by its windowed moments.
#import ssim_moments
#import reduce

@group(0) @binding(0) var<storage, read> image: array<f32>;
@group(0) @binding(1) var<storage, read> photo: array<u32>;
// Nine planes: for each channel dSSIM/d(mu_x), /d(E[x x]), /d(E[x y]).
@group(0) @binding(2) var<storage, read_write> moments: array<f32>;
// (sum |x - y|, sum SSIM, sum of squared errors of the clamped image, 0) of each workgroup.
@group(0) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_id) lid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let c = wid.z;
    let shift = moment_shift(wid.xy, c);
    for (var k = local; k < SIDE * SIDE; k += TILE * TILE) {
        let p = halo_pixel(wid.xy, k);
        var x = 0.0;
        var y = 0.0;
        if p >= 0 {
            x = image[3u * u32(p) + c];
            let texel = photo[p];
            y = select(x, target_channel(texel, c), target_counts(texel));
        }
        values[k] = vec2(x, y) - shift;
    }
    let s = windowed_means(lid, local);
    var result = vec4(0.0);
    let pixel = wid.xy * TILE + lid.xy;
    if all(pixel < params.size) {
        let derivatives = ssim_derivatives(s, shift);
        let p = pixel.y * params.size.x + pixel.x;
        store_derivatives(c, p, derivatives);
        let at = (lid.y + RADIUS) * SIDE + lid.x + RADIUS;
        let v = values[at];
        let seen = clamp(v + shift, vec2(0.0), vec2(1.0));
        let error = seen.x - seen.y;
        result = vec4(abs(v.x - v.y), derivatives.ssim, error * error, 0.0);
    }
    let sum = reduce(local, result);
    if local == 0u {
        partials[(wid.z * params.tiles.y + wid.y) * params.tiles.x + wid.x] = sum;
    }
}
