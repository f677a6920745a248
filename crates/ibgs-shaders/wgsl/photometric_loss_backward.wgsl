//! SSIM of a photo and the images warped to it, gradient by the warped colours, one visible source.
#set train
#stage photometric loss backward
// One workgroup a tile and channel of one of the visible sources: gradient of the photometric loss by the warped colours, times the
// upstream scalar; zero where a pixel does not count. The cosine beside the colour has none.
#import ssim_maps
#import seen

@group(0) @binding(0) var<storage, read> warped: array<f32>;
@group(0) @binding(1) var<storage, read> seen: array<u32>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
@group(0) @binding(3) var<storage, read> moments: array<f32>;
/// (loss, pixels and channels that count in all of them).
@group(0) @binding(4) var<storage, read> stats: array<f32>;
@group(0) @binding(5) var<storage, read> v_loss: array<f32>;
@group(0) @binding(6) var<storage, read_write> v_warped: array<f32>;

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
    let p = pixel.y * params.size.x + pixel.x;
    let at = 4u * (params.visible_index * plane + p) + c;
    let texel = photo[p];
    var v = 0.0;
    if photo_valid(texel) && seen_agrees(seen[p], params.visible_index) {
        let s = window_sums(lid);
        let by_ssim = s.x + 2.0 * warped[at] * s.y + photo_channel(texel, c) * s.z;
        v = -v_loss[0] * params.lambda * by_ssim / stats[1];
    }
    v_warped[at] = v;
    if c == 2u {
        v_warped[at + 1u] = 0.0;
    }
}
