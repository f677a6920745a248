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
    load_maps(wid.xy, c, local);
    let pixel = wid.xy * TILE + lid.xy;
    if any(pixel >= params.size) {
        return;
    }
    let s = window_sums(lid);
    let p = pixel.y * params.size.x + pixel.x;
    let texel = photo[p];
    var v = 0.0;
    if target_counts(texel) {
        let x = image[3u * p + c];
        let y = target_channel(texel, c);
        let by_ssim = s.x + 2.0 * x * s.y + y * s.z;
        v = v_loss[0] * ((1.0 - params.lambda) * sign(x - y) - params.lambda * by_ssim) / (3.0 * f32(plane));
    }
    v_image[3u * p + c] = v;
}
