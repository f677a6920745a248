//! The WGSL compute kernels of ibgs and what the host must know of them: bindings with access, workgroup size,
//! immediate data, shared constants. Knows neither wgpu devices nor burn.

mod import;
pub mod types;

pub use import::resolve;

/// Side of a square tile in pixels.
pub const TILE: u32 = 16;
/// Gaussians at or in front of this view depth are culled.
pub const NEAR_DEPTH: f32 = 0.2;
/// Variance in square pixels added to the diagonal of the projected covariance.
pub const COV_BLUR: f32 = 0.3;
/// Contributions under this alpha are skipped.
pub const ALPHA_MIN: f32 = 1.0 / 255.0;
/// Largest alpha of a single Gaussian.
pub const ALPHA_MAX: f32 = 0.99;
/// Blending stops before the transmittance would fall under this.
pub const T_MIN: f32 = 1e-4;
/// Keys a workgroup of the radix sort handles.
pub const SORT_BLOCK: u32 = 2048;
/// Digits of one radix pass (8 bits).
pub const SORT_BINS: u32 = 256;
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

/// How a kernel uses a storage buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// `var<storage, read>`
    Read,
    /// `var<storage, read_write>`
    ReadWrite,
}

/// One storage binding of group 0; its index is its position in [`Kernel::bindings`].
#[derive(Clone, Copy, Debug)]
pub struct Binding {
    /// Variable name in the WGSL source.
    pub name: &'static str,
    /// Declared access.
    pub access: Access,
}

/// A compute kernel: one file under `wgsl/`, entry point `main`.
#[derive(Debug)]
pub struct Kernel {
    /// File name without extension.
    pub name: &'static str,
    /// Text of the file, imports not yet resolved.
    pub source: &'static str,
    /// Storage bindings of group 0 in binding order.
    pub bindings: &'static [Binding],
    /// Workgroup size.
    pub workgroup: [u32; 3],
    /// Size in bytes of the immediate data (0: none).
    pub immediates: u32,
}

const fn read(name: &'static str) -> Binding {
    Binding { name, access: Access::Read }
}

const fn write(name: &'static str) -> Binding {
    Binding { name, access: Access::ReadWrite }
}

macro_rules! kernels {
    ($($(#[$doc:meta])* $ident:ident = $name:literal [$($x:expr),+] ($immediates:expr): $($binding:expr),+;)+) => {
        $($(#[$doc])*
        pub static $ident: Kernel = Kernel {
            name: $name,
            source: include_str!(concat!("../wgsl/", $name, ".wgsl")),
            bindings: &[$($binding),+],
            workgroup: [$($x),+],
            immediates: $immediates as u32,
        };)+
        /// Every kernel.
        pub static KERNELS: &[&Kernel] = &[$(&$ident),+];
    };
}

kernels! {
    /// Culling, projection, colour, depth keys, tile counts.
    PROJECT = "project" [256, 1, 1] (size_of::<types::Frame>()):
        read("means"), read("rotations"), read("log_scales"), read("opacity_logits"), read("sh"),
        write("projected"), write("depth_keys"), write("tile_counts");
    /// `gathered[i] = values[order[i]]`.
    GATHER = "gather" [256, 1, 1] (4): read("values"), read("order"), write("gathered");
    /// Prefix sum, block sums.
    SCAN_REDUCE = "scan_reduce" [256, 1, 1] (4): read("values"), write("block_sums");
    /// Prefix sum of the block sums, grand total.
    SCAN_BLOCKS = "scan_blocks" [256, 1, 1] (4): write("block_sums"), write("total");
    /// Prefix sum inside the blocks.
    SCAN_APPLY = "scan_apply" [256, 1, 1] (4): read("values"), read("block_sums"), write("sums");
    /// Radix sort, digit histograms.
    SORT_COUNT = "sort_count" [256, 1, 1] (size_of::<types::SortParams>()):
        read("keys"), read("count"), write("histogram");
    /// Radix sort, stable scatter.
    SORT_SCATTER = "sort_scatter" [256, 1, 1] (size_of::<types::SortParams>()):
        read("keys_in"), read("values_in"), read("count"), read("starts"), write("keys_out"), write("values_out");
    /// Tile intersections in depth order.
    TILE_EMIT = "tile_emit" [256, 1, 1] (size_of::<types::Frame>()):
        read("projected"), read("depth_order"), read("offsets"), read("tile_counts"),
        write("isect_tiles"), write("isect_to_gaussian");
    /// Start and end of each tile's list.
    TILE_RANGES = "tile_ranges" [256, 1, 1] (size_of::<types::Frame>()):
        read("sorted_tiles"), read("sorted_isects"), read("isect_to_gaussian"), read("count"),
        write("sorted_gaussians"), write("tile_ranges");
    /// Alpha blending.
    RASTERIZE = "rasterize" [TILE, TILE, 1] (size_of::<types::Frame>()):
        read("projected"), read("sorted_gaussians"), read("tile_ranges"),
        write("image"), write("final_t"), write("last_entry");
    /// Gradient of the blending by the projected quantities, a row an intersection.
    RASTERIZE_BACKWARD = "rasterize_backward" [TILE, TILE, 1] (size_of::<types::Frame>()):
        read("projected"), read("sorted_gaussians"), read("sorted_isects"), read("tile_ranges"), read("final_t"),
        read("last_entry"), read("v_image"), write("v_isect_color"), write("v_isect_xy"), write("v_isect_cov");
    /// Gradient of the projection by the raw parameters.
    PROJECT_BACKWARD = "project_backward" [256, 1, 1] (size_of::<types::Frame>()):
        read("means"), read("rotations"), read("log_scales"), read("sh"), read("projected"), read("depth_order"),
        read("offsets"), read("tile_counts"), read("v_isect_color"), read("v_isect_xy"), read("v_isect_cov"),
        write("v_means"), write("v_rotations"), write("v_log_scales"), write("v_opacity_logits"), write("v_sh"),
        write("v_screen");
    /// L1 + SSIM, forward.
    IMAGE_LOSS = "image_loss" [TILE, TILE, 1] (size_of::<types::LossParams>()):
        read("image"), read("photo"), write("moments"), write("partials");
    /// L1 + SSIM, sum over the tiles.
    IMAGE_LOSS_TOTAL = "image_loss_total" [256, 1, 1] (size_of::<types::LossParams>()):
        read("partials"), write("loss"), write("stats");
    /// L1 + SSIM, gradient by the image.
    IMAGE_LOSS_BACKWARD = "image_loss_backward" [TILE, TILE, 1] (size_of::<types::LossParams>()):
        read("image"), read("photo"), read("moments"), read("v_loss"), write("v_image");
    /// Adam.
    ADAM = "adam" [256, 1, 1] (size_of::<types::AdamParams>()):
        read("gradient"), write("values"), write("moment1"), write("moment2");
    /// Densification statistics.
    DENSIFY_OBSERVE = "densify_observe" [256, 1, 1] (size_of::<types::ObserveParams>()):
        read("v_screen"), read("projected"), write("statistics");
    /// Rows of the next model from rows of the last.
    DENSIFY_GATHER = "densify_gather" [256, 1, 1] (size_of::<types::GatherParams>()):
        read("sources"), read("previous"), write("next");
    /// Opacity clamped from above.
    OPACITY_RESET = "opacity_reset" [256, 1, 1] (size_of::<types::OpacityResetParams>()):
        write("opacity_logits"), write("moment1"), write("moment2");
    // The hourglass of the residual network.
    /// 3 x 3 convolution, forward or gradient by the input.
    RESIDUAL_CONV = "residual_conv" [128, 1, 1] (size_of::<types::ConvParams>()):
        read("weights"), read("input_a"), read("input_b"), write("output");
    /// 3 x 3 convolution, partial sums of the gradient by weights and biases.
    RESIDUAL_CONV_WEIGHTS = "residual_conv_weights" [192, 1, 1] (size_of::<types::ConvWeightsParams>()):
        read("v"), read("input"), write("partials");
    /// Rows of partial sums into the flat weight gradient.
    RESIDUAL_SUM = "residual_sum" [256, 1, 1] (size_of::<types::SumParams>()): read("partials"), write("sums");
    /// Gradient of the 2 x 2 maximum.
    RESIDUAL_POOL_BACKWARD = "residual_pool_backward" [256, 1, 1] (size_of::<types::PoolParams>()):
        read("activation"), read("v_pooled"), write("v");
    /// Gradient of the enlargement by nearest.
    RESIDUAL_UPSAMPLE_BACKWARD = "residual_upsample_backward" [256, 1, 1] (size_of::<types::UpsampleParams>()):
        read("v_enlarged"), write("v");
    /// The last two layers.
    RESIDUAL_HEAD = "residual_head" [128, 1, 1] (size_of::<types::HeadParams>()):
        read("weights"), read("d1"), read("x"), write("residual"), write("f");
    /// The last two layers, gradient by their inputs.
    RESIDUAL_HEAD_BACKWARD = "residual_head_backward" [128, 1, 1] (size_of::<types::HeadParams>()):
        read("weights"), read("v_residual"), write("d1"), write("f");
    /// The last two layers, partial sums of the gradient by weights and biases.
    RESIDUAL_HEAD_WEIGHTS = "residual_head_weights" [192, 1, 1] (size_of::<types::HeadParams>()):
        read("weights"), read("d1"), read("x"), read("f"), read("v_residual"), write("partials");
}

/// The shared constants as WGSL declarations.
pub fn constants() -> String {
    use std::fmt::Write;
    let mut text = String::new();
    for (name, value) in
        [("TILE", TILE), ("SORT_BLOCK", SORT_BLOCK), ("SORT_BINS", SORT_BINS), ("SCAN_BLOCK", SCAN_BLOCK)]
    {
        let _ = writeln!(text, "const {name}: u32 = {value}u;");
    }
    for (name, value) in [
        ("NEAR_DEPTH", NEAR_DEPTH),
        ("COV_BLUR", COV_BLUR),
        ("ALPHA_MIN", ALPHA_MIN),
        ("ALPHA_MAX", ALPHA_MAX),
        ("T_MIN", T_MIN),
        ("SSIM_C1", SSIM_C1),
        ("SSIM_C2", SSIM_C2),
    ] {
        let _ = writeln!(text, "const {name}: f32 = {value:e}f;");
    }
    let window = ssim_window().map(|w| format!("{:e}f", w as f32)).join(", ");
    let _ = writeln!(text, "const SSIM_WINDOW = array<f32, {}>({window});", 2 * SSIM_RADIUS + 1);
    text
}

impl Kernel {
    /// The complete WGSL source: shared constants, imported files, the kernel.
    pub fn wgsl(&self) -> String {
        format!("{}{}", constants(), resolve(self.source))
    }
}
