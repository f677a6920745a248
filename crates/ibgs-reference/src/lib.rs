//! Double-precision CPU twins of the GPU kernels of base 3D Gaussian splatting (method.md section 2), of the geometry
//! (section 3), of warping (section 5), of the losses (section 7), of the exposure correction (section 8) and of the
//! optimiser (section 1). They are written for clarity and are the authority of the tests: finite differences and the
//! golden data hold them to method.md, and the kernels are then held to them.
//!
//! `render` = `project::project` + `raster::rasterize`; `backward` = `raster::rasterize_backward` +
//! `project::project_backward`. `geometry::geometry` and `warp::warp` follow the former, and then
//! `geometry_backward` takes the place of the latter. Each stage can be compared on its own.
#![allow(missing_docs, clippy::print_stdout, clippy::len_without_is_empty, reason = "for tests alone")]

pub mod adam;
pub mod backward;
pub mod camera_gradient;
pub mod exposure;
pub mod features;
pub mod finite;
pub mod geometry;
pub mod geometry_backward;
pub mod golden;
pub mod gpu;
pub mod image_loss;
pub mod lpips;
pub mod normal_loss;
pub mod photometric_loss;
pub mod plane_sweep;
pub mod project;
pub mod random_scene;
pub mod raster;
pub mod sh;
pub mod sort;
pub mod surface_scene;
pub mod unet;
pub mod warp;
pub mod whole_loss;

pub use backward::backward;
pub use project::project;
pub use raster::{rasterize, render, render_as};

/// Width and height of a tile in pixels.
pub const TILE: u32 = 16;
/// Gaussians at this view depth or nearer are culled.
pub const NEAR: f64 = 0.05;
/// Added to the diagonal of the 2D covariance, in square pixels.
pub const BLUR: f64 = 0.3;
/// Blended opacities are clamped at this value.
pub const MAX_ALPHA: f64 = 0.99;
/// Blended opacities under this value are skipped.
pub const MIN_ALPHA: f64 = 1.0 / 255.0;
/// Blending stops before the transmittance would fall under this value.
pub const MIN_TRANSMITTANCE: f64 = 1e-4;

/// How the projection treats what lies far from a Gaussian's centre or from the field of view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Model {
    /// As the kernels: a Gaussian reaches every pixel where its alpha is 1/255 or more, and the Jacobian's ratios are held.
    #[default]
    Outline,
    /// As method.md section 2 and the kernels' published setting: it also touches the tiles of its radius only.
    Boxed,
    /// Neither box nor held ratios, as the golden gradients.
    Ideal,
}

/// The trained tensors of base splatting, in the order of [`PerGaussian`](ibgs_data::scene::PerGaussian).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tensor {
    Means,
    Rotations,
    LogScales,
    OpacityLogits,
    Sh,
}

impl Tensor {
    pub const ALL: [Tensor; 5] =
        [Tensor::Means, Tensor::Rotations, Tensor::LogScales, Tensor::OpacityLogits, Tensor::Sh];

    /// Its name in the golden data.
    pub fn name(self) -> &'static str {
        surface_scene::TENSORS[self as usize]
    }

    /// The one with this name.
    pub fn named(name: &str) -> Option<Tensor> {
        Tensor::ALL.into_iter().find(|tensor| tensor.name() == name)
    }
}

/// Scene parameters before activation (method.md section 1): f64 that hold values representable in f32.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Params {
    pub means: Vec<[f64; 3]>,
    /// Quaternions w, x, y, z, not normalised.
    pub rotations: Vec<[f64; 4]>,
    pub log_scales: Vec<[f64; 3]>,
    pub opacity_logits: Vec<f64>,
    /// N x C x 3 with C = (sh_degree + 1)^2: Gaussian, then coefficient, then channel.
    pub sh: Vec<f64>,
    pub sh_degree: usize,
}

impl Params {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Spherical-harmonics coefficients per channel that are stored.
    pub fn sh_coefficients(&self) -> usize {
        (self.sh_degree + 1).pow(2)
    }

    /// All coefficients of Gaussian `i`, coefficient-major then channel.
    pub fn sh_of(&self, i: usize) -> &[f64] {
        let stride = 3 * self.sh_coefficients();
        &self.sh[i * stride..(i + 1) * stride]
    }

    /// One tensor as a flat slice.
    pub fn get(&self, tensor: Tensor) -> &[f64] {
        match tensor {
            Tensor::Means => self.means.as_flattened(),
            Tensor::Rotations => self.rotations.as_flattened(),
            Tensor::LogScales => self.log_scales.as_flattened(),
            Tensor::OpacityLogits => &self.opacity_logits,
            Tensor::Sh => &self.sh,
        }
    }

    /// One tensor as a flat mutable slice.
    pub fn get_mut(&mut self, tensor: Tensor) -> &mut [f64] {
        match tensor {
            Tensor::Means => self.means.as_flattened_mut(),
            Tensor::Rotations => self.rotations.as_flattened_mut(),
            Tensor::LogScales => self.log_scales.as_flattened_mut(),
            Tensor::OpacityLogits => &mut self.opacity_logits,
            Tensor::Sh => &mut self.sh,
        }
    }

    /// One tensor flat and in f32, as it is uploaded.
    pub fn get_f32(&self, tensor: Tensor) -> Vec<f32> {
        self.get(tensor).iter().map(|v| *v as f32).collect()
    }
}

/// A Gaussian as the blending sees it. All numbers are zero where it is not visible.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Projected {
    /// In front of the near plane, finite, and its rectangle touches at least one tile.
    pub visible: bool,
    /// Projected mean in pixel-index coordinates: u - 0.5 for u with pixel centres at +0.5.
    pub xy: [f64; 2],
    /// View depth z.
    pub depth: f64,
    /// Inverse 2D covariance: xx, xy, yy.
    pub conic: [f64; 3],
    /// After the sigmoid.
    pub opacity: f64,
    /// 0.5 + SH, clamped at 0 from below.
    pub color: [f64; 3],
    /// Tile rectangle x0, y0, x1, y1 with x1 and y1 exclusive.
    pub rect: [u32; 4],
    /// Three standard deviations along the longest axis, in whole pixels.
    pub radius: f64,
}

/// What `rasterize` gives. Pixels are row by row, tiles too.
#[derive(Clone, Debug)]
pub struct Forward {
    pub image: Vec<[f64; 3]>,
    /// Transmittance left behind the last contributor.
    pub final_t: Vec<f64>,
    /// Number of entries of the tile's list walked up to and including the last contributor (0: none).
    pub last: Vec<u32>,
    /// Per tile the Gaussians by f32 view depth, then index.
    pub order: Vec<Vec<u32>>,
    /// The projection that was blended.
    pub projected: Vec<Projected>,
    /// SH degree that was active.
    pub active_sh_degree: usize,
    /// How it was projected.
    pub model: Model,
}

/// Gradients by what the blending reads, per Gaussian: the output of `rasterize_backward`.
#[derive(Clone, Debug, Default)]
pub struct SplatGrads {
    /// By the projected mean in pixels, summed over pixels.
    pub xy: Vec<[f64; 2]>,
    /// Absolute values of the same summed over pixels.
    pub xy_abs: Vec<[f64; 2]>,
    /// By the three numbers xx, xy, yy of the conic (xy counts once).
    pub conic: Vec<[f64; 3]>,
    /// By the opacity after the sigmoid.
    pub opacity: Vec<f64>,
    /// By the clamped colour.
    pub color: Vec<[f64; 3]>,
}

/// Gradients by the raw parameters and by the projected mean.
#[derive(Clone, Debug, Default)]
pub struct Grads {
    pub means: Vec<[f64; 3]>,
    pub rotations: Vec<[f64; 4]>,
    pub log_scales: Vec<[f64; 3]>,
    pub opacity_logits: Vec<f64>,
    pub sh: Vec<f64>,
    /// By the projected mean in pixels, summed over pixels.
    pub xy: Vec<[f64; 2]>,
    /// Absolute values of the same summed over pixels.
    pub xy_abs: Vec<[f64; 2]>,
}

impl Grads {
    /// One tensor as a flat slice.
    pub fn get(&self, tensor: Tensor) -> &[f64] {
        match tensor {
            Tensor::Means => self.means.as_flattened(),
            Tensor::Rotations => self.rotations.as_flattened(),
            Tensor::LogScales => self.log_scales.as_flattened(),
            Tensor::OpacityLogits => &self.opacity_logits,
            Tensor::Sh => &self.sh,
        }
    }
}

/// ||a - b||_2 / ||b||_2, or ||a||_2 where b is all zero.
pub fn relative_error(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "tensors of different length");
    let norm = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
    let reference = norm(&mut b.iter().copied());
    let difference = norm(&mut a.iter().zip(b).map(|(x, y)| x - y));
    if reference > 0.0 { difference / reference } else { difference }
}

/// Peak signal-to-noise ratio in dB for values with a range of one.
pub fn psnr(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "images of different size");
    let squares: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
    -10.0 * (squares / a.len() as f64).log10()
}
