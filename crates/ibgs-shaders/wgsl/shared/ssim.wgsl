// Shared pieces of the losses with SSIM (method.md section 7): an 11 x 11 Gaussian window, separable, zero padding.
#import photo

/// The image loss and the photometric loss.
struct LossParams {
    /// Image size in pixels.
    size: vec2<u32>,
    /// Image size in tiles.
    tiles: vec2<u32>,
    /// Colour behind the photo of an object.
    background: vec3<f32>,
    /// 1: the photo shows an object over the background, and alpha says how much of it; 0: alpha under one half is
    /// masked.
    object: u32,
    /// Weight of 1 - SSIM; L1 has the rest.
    lambda: f32,
    /// Index m among the V visible sources of the warped image; 0 in the image loss.
    visible_index: u32,
    /// Padding.
    pad: vec2<u32>,
}

var<immediate> params: LossParams;

// Whether the image loss compares a pixel with the photo.
fn target_counts(texel: u32) -> bool {
    return select(photo_valid(texel), (texel >> 24u) >= ALPHA_EMPTY, params.object == 1u);
}

// Share of the background in what the image loss compares with.
fn background_share(texel: u32) -> f32 {
    return select(0.0, 1.0 - photo_cover(texel), params.object == 1u);
}

// What the image loss compares channel c with.
fn target_channel(texel: u32, c: u32) -> f32 {
    let color = photo_channel(texel, c);
    return select(color, mix(params.background[c], color, photo_cover(texel)), params.object == 1u);
}

const RADIUS: u32 = SSIM_RADIUS;
// The sums over the window are written out, 11 terms each.
const_assert 2u * RADIUS + 1u == 11u;
// A tile with its halo.
const SIDE: u32 = TILE + 2u * RADIUS;

struct SsimDerivatives {
    ssim: f32,
    by_mu: f32,
    by_xx: f32,
    by_xy: f32,
}

// Windowed means of x, y, x x, y y, and of x y.
struct Means {
    own: vec4<f32>,
    xy: f32,
}

// SSIM and its derivatives by mu_x, E[x x] and E[x y], from the windowed means of values less `shift`.
fn ssim_derivatives(s: Means, shift: f32) -> SsimDerivatives {
    let mu_x = s.own.x + shift;
    let mu_y = s.own.y + shift;
    let var_x = s.own.z - s.own.x * s.own.x;
    let var_y = s.own.w - s.own.y * s.own.y;
    let cov = s.xy - s.own.x * s.own.y;
    let a = mu_x * mu_x + mu_y * mu_y + SSIM_C1;
    let b = var_x + var_y + SSIM_C2;
    let n = 2.0 * mu_x * mu_y + SSIM_C1;
    let d = 2.0 * cov + SSIM_C2;
    let ssim = n * d / (a * b);
    let by_xx = -ssim / b;
    let by_xy = 2.0 * n / (a * b);
    let by_mu = 2.0 * mu_y * d / (a * b) - 2.0 * mu_x * ssim / a - 2.0 * mu_x * by_xx - mu_y * by_xy;
    return SsimDerivatives(ssim, by_mu, by_xx, by_xy);
}
