// Windowed means of a tile for SSIM, forward. The kernel declares the buffer `moments`: nine planes, for each channel dSSIM/d(mu_x),
// /d(E[x x]), /d(E[x y]).
#import ssim
#if NARROW
#import ssim_moments_narrow
#else
#import ssim_moments_wide
#endif

// Moments are taken about the tile's middle photo value: E[x x] - mu mu would cancel in flat bright parts.
fn moment_shift(tile: vec2<u32>, c: u32) -> f32 {
    let middle = min(tile * TILE + TILE / 2u, params.size - 1u);
    let texel = photo[middle.y * params.size.x + middle.x];
    return select(0.5, target_channel(texel, c), target_counts(texel));
}

fn store_derivatives(c: u32, p: u32, d: SsimDerivatives) {
    let plane = params.size.x * params.size.y;
    moments[(3u * c) * plane + p] = d.by_mu;
    moments[(3u * c + 1u) * plane + p] = d.by_xx;
    moments[(3u * c + 2u) * plane + p] = d.by_xy;
}
