//! Pixels of large error that each Gaussian covers.
#set train
#stage other
// One workgroup a tile, one thread a pixel: counts for each Gaussian the pixels with an error above the image's mean to which it
// contributes (the counting of FastGS, 2025). Only integers are added, so the order of the threads does not matter.
#import ssim
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(2) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(3) var<storage, read> last_entry: array<u32>;
@group(0) @binding(4) var<storage, read> image: array<f32>;
@group(0) @binding(5) var<storage, read> photo: array<u32>;
/// (loss, mean |x - y|, mean SSIM, mean squared error).
@group(0) @binding(6) var<storage, read> stats: array<f32>;
@group(0) @binding(7) var<storage, read_write> counts: array<atomic<u32>>;

// Least weight, alpha times transmittance, in the pixel's colour.
const LEAST_WEIGHT: f32 = 0.05;

@compute @workgroup_size(TILE, TILE)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_id) lid: vec3<u32>) {
    let pixel = wid.xy * TILE + lid.xy;
    if any(pixel >= params.size) {
        return;
    }
    let p = pixel.y * params.size.x + pixel.x;
    let texel = photo[p];
    var error = 0.0;
    for (var c = 0u; c < 3u; c++) {
        error += abs(image[3u * p + c] - target_channel(texel, c));
    }
    if !target_counts(texel) || error <= 3.0 * stats[1] {
        return;
    }
    let at = vec2<f32>(pixel);
    let start = tile_ranges[2u * (wid.y * params.tiles.x + wid.x)];
    let end = start + last_entry[p];
    var t = 1.0;
    for (var k = start; k < end; k++) {
        let g = sorted_gaussians[k];
        let a = projected[3u * g];
        let b = projected[3u * g + 1u];
        let alpha = min(ALPHA_MAX, b.y * exp(-falloff(a.xy - at, vec3(a.zw, b.x))));
        if alpha < ALPHA_MIN {
            continue;
        }
        if alpha * t >= LEAST_WEIGHT {
            atomicAdd(&counts[g], 1u);
        }
        t *= 1.0 - alpha;
    }
}
