//! L1 + SSIM, gradient by the image.
#set train
#stage image loss backward
// One workgroup a tile and channel: gradient of the L1 + SSIM loss by the image, times the upstream scalar.
#import ssim_maps

@group(0) @binding(0) var<storage, read> image: array<f32>;
@group(0) @binding(1) var<storage, read> photo: array<u32>;
@group(0) @binding(2) var<storage, read> moments: array<f32>;
@group(0) @binding(3) var<storage, read> v_loss: array<f32>;
@group(0) @binding(4) var<storage, read_write> v_image: array<f32>;

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_id) lid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let c = wid.z;
    let plane = params.size.x * params.size.y;
    let pixel = wid.xy * TILE + lid.xy;
    let within = min(pixel, params.size - 1u);
    let p = within.y * params.size.x + within.x;
    // Read before the maps, so that all wait together.
    let texel = photo[p];
    let x = image[3u * p + c];
    let upstream = v_loss[0];
    load_maps(wid.xy, c, local);
    if any(pixel >= params.size) {
        return;
    }
    let s = window_sums(lid);
    var v = 0.0;
    if target_counts(texel) {
        let y = target_channel(texel, c);
        let by_ssim = s.x + 2.0 * x * s.y + y * s.z;
        v = upstream * ((1.0 - params.lambda) * sign(x - y) - params.lambda * by_ssim) / (3.0 * f32(plane));
    }
    v_image[3u * p + c] = v;
}
