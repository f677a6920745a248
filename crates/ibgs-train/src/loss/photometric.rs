//! The photometric loss (method.md section 7): SSIM of the photo and the source photos warped to it, as a burn autodiff
//! operation.

use super::{Loss, LossInputs};
use crate::autodiff::unary;
use crate::tensor::{bind, empty_like};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::config::schedule::Schedule;
use ibgs_core::gpu::pool::{Lease, Pool};
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_core::sources::{DevicePhoto, MAX_VISIBLE};
use ibgs_shaders::TILE;
use ibgs_shaders::bindings::{LossMeanBindings, PhotometricLossBackwardBindings, PhotometricLossBindings};
use ibgs_shaders::types::{LossParams, MeanParams};
use std::sync::Arc;

/// Scratch memory of one image size and number of visible sources.
#[derive(Debug)]
struct Scratch {
    /// Derivatives of SSIM by its windowed moments, a buffer a source: together they could outgrow one binding.
    moments: Vec<Buffer<f32>>,
    partials: Buffer<[f32; 2]>,
    /// (loss, pixels and channels that count).
    stats: Buffer<f32>,
    pixels: usize,
    groups: usize,
}

/// `weight x mean over visible (source, pixel) of 1 - SSIM_p(photo, warped)`; owns its scratch memory.
///
/// A pair counts when the source is visible at the pixel, its depth agrees, and the photo is valid there. Around
/// it SSIM sees the warped image where that counts, elsewhere the photo; masked parts of the photo are zero in both, as
/// the outside of the image is.
#[derive(Debug)]
pub struct PhotometricLoss {
    gpu: Arc<Gpu>,
    pool: Arc<Pool<Scratch>>,
    /// Weight of the loss.
    pub weight: f32,
    /// It is part of the iterations at multiples of this.
    every: u32,
}

#[derive(Clone, Debug)]
struct Saved {
    gpu: Arc<Gpu>,
    warped: CubeTensor,
    seen: Buffer<u32>,
    target: DevicePhoto,
    params: LossParams,
    scratch: Arc<Lease<Scratch>>,
}

impl Saved {
    fn visible(&self) -> usize {
        self.warped.meta.shape()[0]
    }

    fn backward(&self, v_loss: &CubeTensor) -> CubeTensor {
        let gpu = &*self.gpu;
        let v_warped = empty_like(&self.warped, self.warped.meta.shape());
        let (warped, upstream, out) = (bind(&self.warped), bind(v_loss), bind(&v_warped));
        let mut pass = Pass::new(gpu, "photometric loss backward");
        let [x, y] = self.params.tiles;
        for (source, moments) in (0..).zip(&self.scratch.moments[..self.visible()]) {
            let buffers = PhotometricLossBackwardBindings {
                warped: &warped,
                seen: &self.seen,
                photo: &self.target.texels,
                moments,
                stats: &self.scratch.stats,
                v_loss: &upstream,
                v_warped: &out,
            };
            let params = LossParams { visible_index: source, ..self.params };
            pass.grid(&buffers, &params, [x, y, 3]);
        }
        pass.submit();
        v_warped
    }
}

impl PhotometricLoss {
    /// A loss with this weight.
    pub fn new(gpu: Arc<Gpu>, weight: f32) -> Self {
        Self { gpu, pool: Arc::default(), weight, every: 1 }
    }

    /// The same as a part of the iterations at multiples of `every`.
    pub fn every(self, every: u32) -> Self {
        Self { every, ..self }
    }

    fn scratch(&self, visible: usize, pixels: usize, groups: usize) -> Result<Lease<Scratch>, GpuError> {
        let fits = |s: &Scratch| s.moments.len() >= visible && s.pixels >= pixels && s.groups >= groups;
        let moments = || self.gpu.allocate("SSIM moments of the warped images", 9 * pixels);
        let make = || {
            Ok(Scratch {
                moments: (0..visible).map(|_| moments()).collect::<Result<_, _>>()?,
                partials: self.gpu.allocate("photometric loss sums", groups)?,
                stats: self.gpu.allocate("photometric loss statistics", 2)?,
                pixels,
                groups,
            })
        };
        self.pool.lease_or(fits, make)
    }

    fn forward(
        &self,
        warped: CubeTensor,
        seen: &Buffer<u32>,
        target: &DevicePhoto,
    ) -> Result<(CubeTensor, Saved), GpuError> {
        let gpu = &*self.gpu;
        let [width, height] = target.size;
        let pixels = (width * height) as usize;
        let visible = warped.meta.shape()[0];
        assert_eq!(warped.meta.shape()[1..], [pixels, 4], "warped images and photo differ in size");
        assert!((1..=MAX_VISIBLE as usize).contains(&visible), "number of warped images");
        gpu.check_size("warped images", 16 * (visible * pixels) as u64)?;
        let tiles = [width.div_ceil(TILE), height.div_ceil(TILE)];
        let params = LossParams { size: target.size, tiles, lambda: self.weight, ..LossParams::default() };
        let groups = 3 * visible as u32 * tiles[0] * tiles[1];
        let scratch = self.scratch(visible, pixels, groups as usize)?;
        let loss = empty_like(&warped, &[1]);
        let (bound_warped, bound_loss) = (bind(&warped), bind(&loss));
        let mut pass = Pass::new(gpu, "photometric loss");
        let (photo, partials) = (&target.texels, &scratch.partials);
        for (source, moments) in (0..).zip(&scratch.moments[..visible]) {
            let buffers = PhotometricLossBindings { warped: &bound_warped, seen, photo, moments, partials };
            let params = LossParams { visible_index: source, ..params };
            pass.grid(&buffers, &params, [tiles[0], tiles[1], 3]);
        }
        let mean = MeanParams { count: groups, weight: self.weight };
        pass.groups(&LossMeanBindings { partials, loss: &bound_loss, stats: &scratch.stats }, &mean, 1);
        pass.submit();
        let (gpu, seen, target) = (self.gpu.clone(), seen.clone(), target.clone());
        Ok((loss, Saved { gpu, warped, seen, target, params, scratch: Arc::new(scratch) }))
    }

    /// Loss `[1]` of tracked warped images `[V, P, 4]` (V at most 4; colour and cosine, pixels row by row), 0 where
    /// nothing is visible. `seen` holds `[P]` u32: byte m is the number of visible source m, 255 where there
    /// is none. The gradient reaches the colours of the pairs that count; that of the cosine is 0.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// When warped images and photo differ in size, or the images are not on the autodiff graph: bugs of ours.
    pub fn tracked(&self, warped: Tensor<3>, seen: &Buffer<u32>, target: &DevicePhoto) -> Result<Tensor<1>, GpuError> {
        unary(warped, |warped| {
            let (loss, saved) = self.forward(warped, seen, target)?;
            Ok((loss, move |v_loss: &CubeTensor| Some(saved.backward(v_loss))))
        })
    }
}

impl Loss for PhotometricLoss {
    fn uses_burn(&self) -> bool {
        false
    }

    fn reads_sources(&self, iteration: u32, _: &Schedule) -> bool {
        iteration.is_multiple_of(self.every) && self.weight > 0.0
    }

    fn of(&self, inputs: &LossInputs<'_>) -> Result<Option<Tensor<1>>, GpuError> {
        let warped = inputs.warped.filter(|_| self.reads_sources(inputs.iteration, inputs.schedule));
        warped.map(|warped| self.tracked(warped.colors.clone(), &warped.visible, inputs.target)).transpose()
    }
}
