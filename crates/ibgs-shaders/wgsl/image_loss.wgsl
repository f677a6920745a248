//! L1 + SSIM, forward.
#set train
#stage image loss
// One workgroup a tile and channel: |x - y|, SSIM, and the derivatives of SSIM by its windowed moments.
#import ssim_moments
#import reduce

@group(0) @binding(0) var<storage, read> image: array<f32>;
@group(0) @binding(1) var<storage, read> photo: array<u32>;
/// Nine planes: for each channel dSSIM/d(mu_x), /d(E[x x]), /d(E[x y]).
@group(0) @binding(2) var<storage, read_write> moments: array<f32>;
/// (sum |x - y|, sum SSIM, sum of squared errors of the clamped image, 0) of each workgroup.
@group(0) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_id) lid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let c = wid.z;
    #repeat i 3
    let k$i = local + $iu * TILE * TILE;
    let p$i = halo_pixel(wid.xy, k$i);
    let x$i = image[3u * u32(max(p$i, 0)) + c];
    let texel$i = photo[max(p$i, 0)];
    #end
    let shift = moment_shift(wid.xy, c);
    #repeat i 3
    if k$i < SIDE * SIDE {
        let y$i = select(x$i, target_channel(texel$i, c), target_counts(texel$i));
        values[k$i] = select(vec2(0.0), vec2(x$i, y$i), p$i >= 0) - shift;
    }
    #end
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
