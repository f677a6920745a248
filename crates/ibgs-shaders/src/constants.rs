//! Numbers that kernels and host share.

use super::{choices, layers};

/// Side of a square tile in pixels.
pub const TILE: u32 = 16;
/// Gaussians at or in front of this view depth are culled.
pub const NEAR_DEPTH: f32 = 0.05;
/// Variance in square pixels added to the diagonal of the projected covariance.
pub const COV_BLUR: f32 = 0.3;
/// Contributions under this alpha are skipped.
pub const ALPHA_MIN: f32 = 1.0 / 255.0;
/// Alpha, of 255, of a pixel where the photo of an object shows nothing; 0 is where there is no photo, outside of a lens for
/// instance.
pub const ALPHA_EMPTY: u32 = 1;
/// Alpha, of 255, of a pixel that a learned mask hides: just under one half, which leaves it out of the losses.
pub const ALPHA_HIDDEN: u32 = 127;
/// Largest alpha of a single Gaussian.
pub const ALPHA_MAX: f32 = 0.99;
/// Blending stops before the transmittance would fall under this.
pub const T_MIN: f32 = 1e-4;
/// Half the squared Mahalanobis distance at which a Gaussian that is shown as an ellipsoid ends: 1.5 standard deviations.
pub const ELLIPSOID_POWER: f32 = 1.125;
/// Brightness of an ellipsoid at its edge; 1 in its middle.
pub const ELLIPSOID_EDGE: f32 = 0.4;
/// A ray with `-(n_c . r)` under this passes along a plane and does not meet it. Departs from method.md section 3, where
/// any positive depth counts: depth grows with the inverse of that product and its derivative with the square, so that
/// float32 has no digits left there and a few such pixels would rule the gradients.
pub const SLANT_MIN: f32 = 1e-3;
/// Entries of a tile's list that are sorted in registers at once, eight a thread.
pub const SORT_BLOCK: u32 = 2048;
const _: () =
    assert!(SORT_BLOCK.is_power_of_two() && SORT_BLOCK <= 2048, "runs of blocks; eight for each of 256 threads");
/// Values a workgroup of the prefix sum handles.
pub const SCAN_BLOCK: u32 = 2048;
/// First stabiliser of SSIM, 0.01 squared.
pub const SSIM_C1: f32 = 0.0001;
/// Second stabiliser of SSIM, 0.03 squared.
pub const SSIM_C2: f32 = 0.0009;
/// Radius of the SSIM window in pixels (11 x 11).
pub const SSIM_RADIUS: usize = 5;
/// Standard deviation of the SSIM window in pixels.
pub const SSIM_SIGMA: f64 = 1.5;

/// Share of the absolute differences in the normal loss.
pub const NORMAL_L1: f32 = 0.4;
/// Share of `1 - Nd . N` in the normal loss.
pub const NORMAL_DOT: f32 = 0.6;

/// Workgroups, and so partial sums, of the exposure kernels' reductions.
pub const EXPOSURE_GROUPS: u32 = 256;
/// Workgroups, and so partial sums, of the kernels that make gradients by cameras.
pub const CAMERA_GROUPS: u32 = 256;
/// Weight of half the square of a photo's log gains and offsets beside its image loss.
pub const EXPOSURE_PULL: f32 = 0.01;

/// Bits of a value's packed first moment. Three values share two words of 32 bits.
pub const MOMENT1_BITS: u32 = 9;
/// Bits of its packed second moment.
pub const MOMENT2_BITS: u32 = 12;

/// Multiply-adds of a thread of `bench_fma` in one step.
pub const BENCH_FMAS: u32 = 128;

/// The one-dimensional SSIM window, normalised to sum 1.
pub fn ssim_window() -> [f64; 2 * SSIM_RADIUS + 1] {
    let mut window = std::array::from_fn(|i| {
        let d = i as f64 - SSIM_RADIUS as f64;
        (-d * d / (2.0 * SSIM_SIGMA * SSIM_SIGMA)).exp()
    });
    let sum: f64 = window.iter().sum();
    window.iter_mut().for_each(|w| *w /= sum);
    window
}

/// Name and value of the whole numbers that the WGSL gets.
pub(crate) fn whole_numbers() -> impl Iterator<Item = (&'static str, u32)> {
    [
        ("TILE", TILE),
        ("ALPHA_EMPTY", ALPHA_EMPTY),
        ("ALPHA_HIDDEN", ALPHA_HIDDEN),
        ("SORT_BLOCK", SORT_BLOCK),
        ("SCAN_BLOCK", SCAN_BLOCK),
        ("EXPOSURE_GROUPS", EXPOSURE_GROUPS),
        ("CAMERA_GROUPS", CAMERA_GROUPS),
        ("MOMENT1_BITS", MOMENT1_BITS),
        ("MOMENT2_BITS", MOMENT2_BITS),
        ("BENCH_FMAS", BENCH_FMAS),
        ("SSIM_RADIUS", SSIM_RADIUS as u32),
        ("MLP_FEATURES", layers::FEATURES as u32),
        ("MLP_QUADS", layers::FEATURES.div_ceil(4) as u32),
        ("MLP_ROUNDS", (layers::FEATURES + 1).div_ceil(8) as u32),
        ("MLP_CHANNELS", layers::HIDDEN as u32),
        ("NETWORK_CHANNELS", layers::INPUT as u32),
        ("NETWORK_OUTPUTS", layers::OUTPUTS as u32),
        ("CONV_COLUMNS", layers::CONV_TILE[0]),
        ("CONV_ROWS", layers::CONV_TILE[1]),
        ("CONV_OUTPUTS", layers::CONV_OUTPUTS),
        ("HALF_CONV_ROWS", layers::HALF_CONV_ROWS),
        ("HALF_SUBGROUPS", layers::HALF_SUBGROUPS),
        ("CONFIDENCE_OFFSET", layers::CONFIDENCE.offset as u32),
    ]
    .into_iter()
    .chain(choices::CONSTANTS.iter().copied())
}

/// The shared constants as WGSL declarations.
pub fn constants() -> String {
    use std::fmt::Write;
    let mut text = String::new();
    for (name, value) in whole_numbers() {
        let _ = writeln!(text, "const {name}: u32 = {value}u;");
    }
    for (name, value) in [
        ("NEAR_DEPTH", NEAR_DEPTH),
        ("COV_BLUR", COV_BLUR),
        ("ALPHA_MIN", ALPHA_MIN),
        ("ALPHA_MAX", ALPHA_MAX),
        ("T_MIN", T_MIN),
        ("ELLIPSOID_POWER", ELLIPSOID_POWER),
        ("ELLIPSOID_EDGE", ELLIPSOID_EDGE),
        ("SLANT_MIN", SLANT_MIN),
        ("SSIM_C1", SSIM_C1),
        ("SSIM_C2", SSIM_C2),
        ("NORMAL_L1", NORMAL_L1),
        ("NORMAL_DOT", NORMAL_DOT),
        ("EXPOSURE_PULL", EXPOSURE_PULL),
    ] {
        let _ = writeln!(text, "const {name}: f32 = {value:e}f;");
    }
    let window = ssim_window().map(|w| format!("{:e}f", w as f32)).join(", ");
    let _ = writeln!(text, "const SSIM_WINDOW = array<f32, {}>({window});", 2 * SSIM_RADIUS + 1);
    text
}
