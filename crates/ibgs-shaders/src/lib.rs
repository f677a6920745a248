//! The WGSL compute kernels of ibgs and what the host must know of them: bindings with access, workgroup size,
//! immediate data, shared constants. Knows neither wgpu devices nor burn.

#![forbid(unsafe_code)]

mod choices;
mod import;
pub mod layers;
pub mod types;

pub use choices::{Aggregation, ConvInput, NetworkInputs, Output, Presented, Store};
pub use import::resolve;

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
/// Entries of a tile's list that are sorted in registers at once, four a thread.
pub const SORT_BLOCK: u32 = 1024;
const _: () = assert!(SORT_BLOCK.is_power_of_two() && 8 * SORT_BLOCK <= 16384, "runs of blocks; a browser's memory");
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
/// Weight of half the square of a photo's log gains and offsets beside its image loss.
pub const EXPOSURE_PULL: f32 = 0.01;

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
    ($(#[$all_doc:meta])* $all:ident: $($(#[$doc:meta])* $ident:ident = $name:literal [$($x:expr),+] ($immediates:expr): $($binding:expr),+;)+) => {
        $($(#[$doc])*
        pub static $ident: Kernel = Kernel {
            name: $name,
            source: include_str!(concat!("../wgsl/", $name, ".wgsl")),
            bindings: &[$($binding),+],
            workgroup: [$($x),+],
            immediates: $immediates as u32,
        };)+
        $(#[$all_doc])*
        pub static $all: &[&Kernel] = &[$(&$ident),+];
    };
}

kernels! {
    /// The kernels of rendering, which keep to the limits of a browser.
    RENDER_KERNELS:
    /// Culling, projection, colour, tile counts.
    PROJECT = "project" [256, 1, 1] (size_of::<types::ViewUniforms>()):
        read("means"), read("rotations"), read("log_scales"), read("opacity_logits"), read("sh"),
        write("projected"), write("tile_counts"), read("filters");
    /// The same with spherical harmonics in half precision.
    PROJECT_HALF = "project_half" [256, 1, 1] (size_of::<types::ViewUniforms>()):
        read("means"), read("rotations"), read("log_scales"), read("opacity_logits"), read("sh"),
        write("projected"), write("tile_counts"), read("filters");
    /// Prefix sum, block sums.
    SCAN_REDUCE = "scan_reduce" [256, 1, 1] (4): read("values"), write("block_sums");
    /// Prefix sum, grand total.
    SCAN_APPLY = "scan_apply" [256, 1, 1] (4): read("values"), read("block_sums"), write("sums"), write("total");
    /// Tile of each intersection, its place in the tile's list, its Gaussian.
    TILE_EMIT = "tile_emit" [256, 1, 1] (size_of::<types::ViewUniforms>()):
        read("projected"), read("offsets"), read("count"),
        write("isect_tiles"), write("isect_places"), write("isect_to_gaussian"), write("list_lengths"),
        write("tile_counts");
    /// Start and end of each tile's list.
    TILE_STARTS = "tile_starts" [256, 1, 1] (size_of::<types::ViewUniforms>()):
        write("list_lengths"), write("tile_ranges");
    /// Intersections into the lists of their tiles.
    TILE_PLACE = "tile_place" [256, 1, 1] (size_of::<types::ViewUniforms>()):
        read("projected"), read("count"), read("isect_tiles"), read("isect_places"), read("isect_to_gaussian"),
        read("tile_ranges"), write("list");
    /// Each tile's list by depth.
    TILE_SORT = "tile_sort" [SORT_BLOCK / 4, 1, 1] (size_of::<types::ViewUniforms>()):
        read("tile_ranges"), read("isect_to_gaussian"), write("list"), write("sorted_gaussians"), write("sorted_isects");
    /// Plane of each Gaussian in camera space.
    PLANES = "planes" [256, 1, 1] (size_of::<types::ViewUniforms>()):
        read("means"), read("normals"), read("plane_offsets"), write("planes");
    /// Alpha blending.
    RASTERIZE = "rasterize" [TILE * TILE, 1, 1] (size_of::<types::ViewUniforms>()):
        read("projected"), read("sorted_gaussians"), read("tile_ranges"),
        write("image"), write("final_t"), write("last_entry");
    /// Opaque ellipsoids.
    RASTERIZE_ELLIPSOIDS = "rasterize_ellipsoids" [TILE, TILE, 1] (size_of::<types::ViewUniforms>()):
        read("projected"), read("sorted_gaussians"), read("tile_ranges"), write("image");
    /// A part of a frame as 8-bit colours.
    PRESENT = "present" [256, 1, 1] (size_of::<types::PresentParams>()):
        read("values"), read("others"), read("words"), read("palette"), write("pixels");
    /// Alpha blending with normal map, median intersections and median depth, without what gradients need.
    RASTERIZE_SURFACE_IMAGE = "rasterize_surface_image" [TILE * TILE, 1, 1] (size_of::<types::SurfaceUniforms>()):
        read("projected"), read("planes"), read("sorted_gaussians"), read("tile_ranges"),
        write("image"), write("final_t"), write("normal_map"), write("median_depth"), write("intersections");
    /// Median depth alone.
    RASTERIZE_DEPTH = "rasterize_depth" [TILE * TILE, 1, 1] (size_of::<types::SurfaceUniforms>()):
        read("projected"), read("planes"), read("sorted_gaussians"), read("tile_ranges"), write("median_depth");
    /// Colours of one source photo at the median intersections, visibility, packing.
    WARP = "warp" [TILE, TILE, 1] (size_of::<types::SourceParams>()):
        read("median_depth"), read("intersections"), read("photo"), read("source_depth"),
        write("warped"), write("seen"), write("most_visible");
    /// Plane normals from the shortest axes.
    SHORTEST_AXIS = "shortest_axis" [256, 1, 1] (size_of::<types::ViewUniforms>()):
        read("rotations"), read("log_scales"), write("normals"), write("plane_offsets");
    /// What the Gaussians show in a photo's exposure.
    EXPOSE = "expose" [256, 1, 1] (size_of::<types::ExposeParams>()):
        read("exposures"), read("image"), read("transmittance"), write("exposed");
    /// Warped colours in the target's exposure.
    EXPOSE_WARPED = "expose_warped" [256, 1, 1] (size_of::<types::VisibleParams>()):
        read("exposures"), read("warped"), read("seen"), write("shifted");
    /// Features and per-view MLP: the U-Net's input.
    RESIDUAL_FEATURES = "residual_features" [128, 1, 1] (size_of::<types::FeatureParams>()):
        read("base"), read("warped"), read("seen"), read("most_visible"), read("centers"), read("weights"), write("x");
    /// Base colour, sources and the network's output to the final colour.
    RESIDUAL_COMPOSE = "residual_compose" [256, 1, 1] (size_of::<types::ComposeParams>()):
        read("most_visible"), read("seen"), read("base"), read("warped"), read("residual"), write("image");
    /// The final colour towards the sources' mean colour.
    RESIDUAL_MIX = "residual_mix" [256, 1, 1] (size_of::<types::MixParams>()):
        read("warped"), read("seen"), write("image");
    /// 3 x 3 convolution, forward or gradient by the input.
    RESIDUAL_CONV = "residual_conv" [128, 1, 1] (size_of::<types::ConvParams>()):
        read("weights"), read("input_a"), read("input_b"), write("output");
    /// The last two layers.
    RESIDUAL_HEAD = "residual_head" [128, 1, 1] (size_of::<types::HeadParams>()):
        read("weights"), read("d1"), read("x"), write("residual"), write("f");
}

kernels! {
    /// The kernels of training and of measurements.
    TRAIN_KERNELS:
    /// Depth of each pixel by comparing photos on planes.
    PLANE_SWEEP = "plane_sweep" [TILE, TILE, 1] (size_of::<types::SweepParams>()):
        read("photos"), read("sources"), write("found");
    /// Sizes of the 3D smoothing filters.
    FILTER_SIZES = "filter_sizes" [256, 1, 1] (size_of::<types::FilterParams>()):
        read("means"), read("cameras"), write("filters");
    /// Alpha blending with normal map, median intersections and median depth.
    RASTERIZE_SURFACE = "rasterize_surface" [TILE * TILE, 1, 1] (size_of::<types::SurfaceUniforms>()):
        read("projected"), read("planes"), read("sorted_gaussians"), read("tile_ranges"),
        write("image"), write("final_t"), write("last_entry"), write("normal_map"), write("median_depth"),
        write("intersections"), write("intersection_entries");
    /// Gradient of the blending with surface by projected quantities and planes, a row an intersection.
    RASTERIZE_SURFACE_BACKWARD = "rasterize_surface_backward" [TILE * TILE, 1, 1] (size_of::<types::SurfaceUniforms>()):
        read("projected"), read("planes"), read("sorted_gaussians"), read("sorted_isects"), read("tile_ranges"),
        read("final_t"), read("last_entry"), read("median_depth"), read("intersections"), read("intersection_entries"),
        read("v_image"), read("v_normal_map"), read("v_median_depth"), read("v_intersections"),
        write("v_isect_color"), write("v_isect_xy"), write("v_isect_cov"), write("v_isect_plane");
    /// Gradient of the planes by means, normals and offsets.
    PLANES_BACKWARD = "planes_backward" [256, 1, 1] (size_of::<types::ViewUniforms>()):
        read("means"), read("normals"), read("plane_offsets"), read("planes"), read("tile_counts"), read("total"),
        write("v_means"), write("v_normals"), write("v_plane_offsets");
    /// Gradients of each Gaussian's intersections, summed.
    SUM_ROWS = "sum_rows" [256, 1, 1] (size_of::<types::ViewUniforms>()):
        read("offsets"), read("tile_counts"), read("total"), read("v_isect_color"),
        read("v_isect_xy"), read("v_isect_cov"), write("v_rotations"), write("v_screen"), write("v_log_scales");
    /// The same with the gradients by the planes.
    SUM_ROWS_SURFACE = "sum_rows_surface" [256, 1, 1] (size_of::<types::ViewUniforms>()):
        read("offsets"), read("tile_counts"), read("total"), read("v_isect_color"),
        read("v_isect_xy"), read("v_isect_cov"), write("v_rotations"), write("v_screen"), write("v_log_scales"),
        read("v_isect_plane"), write("v_normals"), write("v_plane_offsets");
    /// Gradient of one source's warping by the median intersections and the median depth.
    WARP_BACKWARD = "warp_backward" [TILE, TILE, 1] (size_of::<types::SourceParams>()):
        read("median_depth"), read("intersections"), read("photo"), read("warped"), read("seen"), read("v_warped"),
        write("v_intersections"), write("v_median_depth");
    /// Gradient of the blending by the projected quantities, a row an intersection.
    RASTERIZE_BACKWARD = "rasterize_backward" [TILE * TILE, 1, 1] (size_of::<types::ViewUniforms>()):
        read("projected"), read("sorted_gaussians"), read("sorted_isects"), read("tile_ranges"), read("final_t"),
        read("last_entry"), read("v_image"), write("v_isect_color"), write("v_isect_xy"), write("v_isect_cov");
    /// Gradient of the projection by the raw parameters.
    PROJECT_BACKWARD = "project_backward" [128, 1, 1] (size_of::<types::ViewUniforms>()):
        read("means"), read("rotations"), read("log_scales"), read("sh"), read("projected"), read("tile_counts"),
        read("total"), write("v_means"), write("v_rotations"), write("v_log_scales"), write("v_opacity_logits"), write("v_sh"),
        write("v_screen"), read("filters");
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
    /// Pixels of large error that each Gaussian covers.
    DENSIFY_ERRORS = "densify_errors" [TILE, TILE, 1] (size_of::<types::LossParams>()):
        read("projected"), read("sorted_gaussians"), read("tile_ranges"), read("last_entry"), read("image"), read("photo"),
        read("stats"), write("counts");
    /// Densification statistics.
    DENSIFY_OBSERVE = "densify_observe" [256, 1, 1] (size_of::<types::ObserveParams>()):
        read("v_screen"), read("projected"), read("errors"), write("statistics");
    /// Rows of the next model from rows of the last.
    DENSIFY_GATHER = "densify_gather" [256, 1, 1] (size_of::<types::GatherParams>()):
        read("sources"), read("previous"), write("next");
    /// Random steps of the means.
    MCMC_NOISE = "mcmc_noise" [256, 1, 1] (size_of::<types::McmcNoiseParams>()):
        read("rotations"), read("log_scales"), read("opacity_logits"), write("means");
    /// Opacity clamped from above.
    OPACITY_RESET = "opacity_reset" [256, 1, 1] (size_of::<types::OpacityResetParams>()):
        write("opacity_logits"), write("moment1"), write("moment2");
    /// Values that are not finite.
    FINITE = "finite" [256, 1, 1] (size_of::<u32>()):
        read("values"), write("broken");
    // Losses of the image-based stage.
    /// A loss that is a weighted mean, from the workgroups' sums.
    LOSS_MEAN = "loss_mean" [256, 1, 1] (size_of::<types::MeanParams>()):
        read("partials"), write("loss"), write("stats");
    /// Depth normals, for pictures.
    DEPTH_NORMALS = "depth_normals" [TILE, TILE, 1] (size_of::<types::SurfaceParams>()):
        read("depth"), write("depth_normals");
    /// Depth normals against the normal map, forward.
    NORMAL_LOSS = "normal_loss" [TILE, TILE, 1] (size_of::<types::SurfaceParams>()):
        read("depth"), read("normal"), read("photo"), write("partials");
    /// Depth normals against the normal map, gradients by median depth and normal map.
    NORMAL_LOSS_BACKWARD = "normal_loss_backward" [TILE, TILE, 1] (size_of::<types::SurfaceParams>()):
        read("depth"), read("normal"), read("photo"), read("v_loss"), write("v_depth"), write("v_normal");
    /// SSIM of a photo and the images warped to it, forward, one visible source.
    PHOTOMETRIC_LOSS = "photometric_loss" [TILE, TILE, 1] (size_of::<types::LossParams>()):
        read("warped"), read("seen"), read("photo"), write("moments"), write("partials");
    /// SSIM of a photo and the images warped to it, gradient by the warped colours, one visible source.
    PHOTOMETRIC_LOSS_BACKWARD = "photometric_loss_backward" [TILE, TILE, 1] (size_of::<types::LossParams>()):
        read("warped"), read("seen"), read("photo"), read("moments"), read("stats"), read("v_loss"), write("v_warped");
    /// Gradient by the image; sums of those by the exposure.
    EXPOSE_BACKWARD = "expose_backward" [256, 1, 1] (size_of::<types::ExposeParams>()):
        read("exposures"), read("image"), read("transmittance"), read("v_exposed"), write("v_image"), write("partials");
    /// Gradient by the exposure.
    EXPOSE_TOTAL = "expose_total" [EXPOSURE_GROUPS, 1, 1] (0):
        read("exposures"), read("partials"), write("v_exposure");
    /// Gradient by the warped colours in the sources' exposures.
    EXPOSE_WARPED_BACKWARD = "expose_warped_backward" [256, 1, 1] (size_of::<types::VisibleParams>()):
        read("exposures"), read("seen"), read("v_shifted"), write("v_warped");
    // The residual network's input, per-view MLP and composition.
    /// Gradient of the per-view MLP by features and weights, a row of weights a workgroup.
    RESIDUAL_FEATURES_BACKWARD = "residual_features_backward" [64, 1, 1] (size_of::<types::FeatureParams>()):
        read("base"), read("warped"), read("seen"), read("most_visible"), read("centers"), read("weights"),
        read("v_x"), write("v_features"), write("partials");
    /// Sum of those rows.
    RESIDUAL_FEATURES_SUM = "residual_features_sum" [256, 1, 1] (size_of::<types::FeatureSumParams>()):
        read("partials"), write("v_weights");
    /// Gradient by warped colours, cosines and base colour.
    RESIDUAL_INPUTS_BACKWARD = "residual_inputs_backward" [256, 1, 1] (size_of::<types::FeatureParams>()):
        read("seen"), read("most_visible"), read("v_x"), read("v_features"), read("base"), read("warped"),
        read("residual"), read("v_image"), write("v_warped"), write("v_base");
    /// Gradient of the composition.
    RESIDUAL_COMPOSE_BACKWARD = "residual_compose_backward" [256, 1, 1] (size_of::<types::ComposeParams>()):
        read("most_visible"), read("seen"), read("base"), read("warped"), read("residual"), read("v_image"),
        write("v_residual"), write("v_base");
    // The U-Net of the residual network.
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
    /// The last two layers, gradient by their inputs.
    RESIDUAL_HEAD_BACKWARD = "residual_head_backward" [128, 1, 1] (size_of::<types::HeadParams>()):
        read("weights"), read("v_residual"), write("d1"), write("f");
    /// The last two layers, partial sums of the gradient by weights and biases.
    RESIDUAL_HEAD_WEIGHTS = "residual_head_weights" [192, 1, 1] (size_of::<types::HeadParams>()):
        read("weights"), read("d1"), read("x"), read("f"), read("v_residual"), write("partials");
    // How fast the device is.
    /// A copy of a large buffer.
    BENCH_COPY = "bench_copy" [256, 1, 1] (4): read("values"), write("copied");
    /// Multiply-adds in registers.
    BENCH_FMA = "bench_fma" [256, 1, 1] (size_of::<types::FmaParams>()): read("factor_and_summand"), write("sums");
}

kernels! {
    /// The kernels that need [`MatrixUnits`]: the residual network in half precision, sums in float32.
    MATRIX_KERNELS:
    /// The U-Net's input in half precision, channels last, in float32 arithmetic.
    RESIDUAL_FEATURES_HALF = "residual_features_half" [128, 1, 1] (size_of::<types::FeatureParams>()):
        read("base"), read("warped"), read("seen"), read("most_visible"), read("centers"), read("weights"), write("x");
    /// The same with the per-view MLP on matrix units of 16 x 16.
    HALF_FEATURES = "half_features" [128, 1, 1] (size_of::<types::FeatureParams>()):
        read("base"), read("warped"), read("seen"), read("most_visible"), read("centers"), read("weights"), write("x");
    /// Gradient of the per-view MLP, rows of weight gradients.
    HALF_FEATURES_BACKWARD = "half_features_backward" [128, 1, 1] (size_of::<types::FeatureParams>()):
        read("base"), read("warped"), read("seen"), read("most_visible"), read("centers"), read("weights"), read("v_x"),
        write("v_features"), write("partials");
    /// All layers' weights to half precision in the order in which the matrix units read them.
    HALF_WEIGHTS = "half_weights" [256, 1, 1] (size_of::<types::HalfWeightsParams>()):
        read("weights"), read("layers"), write("packed");
    /// 3 x 3 convolution, forward or gradient by the input.
    HALF_CONV = "half_conv" [192, 1, 1] (size_of::<types::HalfConvParams>()):
        read("weights"), read("packed"), read("input_a"), read("input_b"), write("output");
    /// The last two layers.
    HALF_HEAD = "half_head" [128, 1, 1] (size_of::<types::HalfHeadParams>()):
        read("weights"), read("packed"), read("d1"), read("x"), write("residual"), write("kept");
    /// Gradient by the last layer's input.
    HALF_HEAD_GRADIENT = "half_head_gradient" [256, 1, 1] (size_of::<types::HalfHeadGradientParams>()):
        read("weights"), read("v_residual"), read("f"), write("v_out"), write("v_f");
    /// Gradients by the inputs of the layer before the last.
    HALF_HEAD_BACKWARD = "half_head_backward" [128, 1, 1] (size_of::<types::HalfHeadBackwardParams>()):
        read("packed"), read("v_f"), write("d1"), write("f");
    /// 3 x 3 convolution, partial sums of the gradient by weights and biases.
    HALF_CONV_WEIGHTS = "half_conv_weights" [288, 1, 1] (size_of::<types::HalfConvWeightsParams>()):
        read("v"), read("input"), write("partials");
    /// The same of a 1 x 1 convolution.
    HALF_LINEAR_WEIGHTS = "half_linear_weights" [288, 1, 1] (size_of::<types::HalfLinearWeightsParams>()):
        read("v"), read("input"), write("partials");
    /// Rows of partial sums into the flat weight gradient.
    HALF_SUM = "half_sum" [256, 1, 1] (size_of::<types::HalfSumParams>()): read("partials"), write("sums");
    /// Gradients in half precision to planes.
    HALF_UNPACK = "half_unpack" [256, 1, 1] (size_of::<types::HalfUnpackParams>()): read("packed"), write("planes");
    /// Gradient of the 2 x 2 maximum.
    HALF_POOL_BACKWARD = "half_pool_backward" [256, 1, 1] (size_of::<types::HalfResizeParams>()):
        read("activation"), read("v_pooled"), write("v");
    /// Gradient of the enlargement by nearest.
    HALF_UPSAMPLE_BACKWARD = "half_upsample_backward" [256, 1, 1] (size_of::<types::HalfResizeParams>()):
        read("v_enlarged"), write("v");
}

/// What the matrix units of an adapter multiply at once (cooperative matrices): `side` x `side` halves, summed in float32.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MatrixUnits {
    /// Rows and columns: 8 or 16.
    pub side: u32,
    /// Lanes of a subgroup.
    pub lanes: u32,
}

impl MatrixUnits {
    fn constants(self) -> String {
        let Self { side, lanes } = self;
        format!(
            "enable f16;\nenable wgpu_cooperative_matrix;\nconst SIDE: u32 = {side}u;\nconst LANES: u32 = {lanes}u;\n\
             alias MatrixA = coop_mat{side}x{side}<f16, A>;\nalias MatrixB = coop_mat{side}x{side}<f16, B>;\n\
             alias MatrixC = coop_mat{side}x{side}<f32, C>;\n"
        )
    }
}

/// The shared constants as WGSL declarations.
pub fn constants() -> String {
    use std::fmt::Write;
    let mut text = String::new();
    for (name, value) in [
        ("TILE", TILE),
        ("ALPHA_EMPTY", ALPHA_EMPTY),
        ("SORT_BLOCK", SORT_BLOCK),
        ("SCAN_BLOCK", SCAN_BLOCK),
        ("EXPOSURE_GROUPS", EXPOSURE_GROUPS),
        ("BENCH_FMAS", BENCH_FMAS),
        ("SSIM_RADIUS", SSIM_RADIUS as u32),
        ("MLP_FEATURES", layers::FEATURES as u32),
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
    .iter()
    .chain(choices::CONSTANTS)
    {
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

impl Kernel {
    /// The complete WGSL source: shared constants, imported files, the kernel.
    pub fn wgsl(&self) -> String {
        format!("{}{}", constants(), resolve(self.source, &[]))
    }

    /// The same for devices whose subgroups all have this number of lanes: 8, 16 or 32. Kernels that have a form for such
    /// devices differ.
    pub fn wgsl_with_subgroups(&self, lanes: u32) -> String {
        format!("const LANES: u32 = {lanes}u;\n{}{}", constants(), resolve(self.source, &["SUBGROUPS"]))
    }

    /// The same for devices without immediate data, which is then a uniform at binding 0 of group 1.
    pub fn wgsl_with_uniform(&self) -> String {
        self.wgsl().replace("var<immediate>", "@group(1) @binding(0) var<uniform>")
    }

    /// Whether it is a part of the residual network.
    pub fn is_of_network(&self) -> bool {
        ["residual_", "half_"].iter().any(|prefix| self.name.starts_with(prefix))
    }

    /// Whether this is one of the [`MATRIX_KERNELS`].
    pub fn needs_matrix_units(&self) -> bool {
        MATRIX_KERNELS.iter().any(|kernel| kernel.name == self.name)
    }

    /// The same of one of the [`MATRIX_KERNELS`].
    pub fn wgsl_for(&self, units: MatrixUnits) -> String {
        format!("{}{}", units.constants(), self.wgsl())
    }
}
