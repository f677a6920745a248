//! `(1 - lambda) L1 + lambda (1 - SSIM)` of an image against a photo, as an operation of burn's autodiff.

use crate::autodiff::unary;
use crate::tensor::{bind, empty_like};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::gpu::pool::{Lease, Pool};
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_core::sources::DevicePhoto;
use ibgs_shaders::bindings::{ImageLossBackwardBindings, ImageLossBindings, ImageLossTotalBindings};
use ibgs_shaders::types::LossParams;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What the loss was made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ImageStats {
    /// The loss.
    pub loss: f32,
    /// Mean absolute error.
    pub l1: f32,
    /// Mean SSIM.
    pub ssim: f32,
    /// Mean squared error of the image clamped to 0..1.
    pub mse: f32,
}

impl ImageStats {
    /// From the four values of a statistics buffer.
    pub fn from_values(v: [f32; 4]) -> Self {
        Self { loss: v[0], l1: v[1], ssim: v[2], mse: v[3] }
    }

    /// Peak signal-to-noise ratio in dB.
    pub fn psnr(&self) -> f32 {
        -10.0 * self.mse.max(1e-10).log10()
    }
}

/// Scratch memory of one image size.
#[derive(Debug)]
pub struct LossScratch {
    moments: Buffer<f32>,
    partials: Buffer<[f32; 4]>,
    /// (loss, L1, SSIM, MSE).
    pub stats: Buffer<f32>,
    pixels: usize,
    groups: usize,
}

/// The image loss; owns its scratch memory.
#[derive(Debug)]
pub struct ImageLoss {
    gpu: Arc<Gpu>,
    pool: Arc<Pool<LossScratch>>,
    /// Weight of 1 - SSIM.
    pub lambda: f32,
}

#[derive(Clone, Debug)]
struct Saved {
    gpu: Arc<Gpu>,
    image: CubeTensor,
    target: DevicePhoto,
    params: LossParams,
    scratch: Arc<Lease<LossScratch>>,
}

impl Saved {
    fn backward(&self, v_loss: &CubeTensor) -> CubeTensor {
        let gpu = &*self.gpu;
        let v_image = empty_like(&self.image, self.image.meta.shape());
        let (image, upstream, out) = (bind(&self.image), bind(v_loss), bind(&v_image));
        let mut pass = Pass::new(gpu, "image loss backward");
        let buffers = ImageLossBackwardBindings {
            image: &image,
            photo: &self.target.texels,
            moments: &self.scratch.moments,
            v_loss: &upstream,
            v_image: &out,
        };
        let [x, y] = self.params.tiles;
        pass.grid(&buffers, &self.params, [x, y, 3]);
        pass.submit();
        v_image
    }
}

impl ImageLoss {
    /// A loss with `lambda` as the weight of 1 - SSIM.
    pub fn new(gpu: Arc<Gpu>, lambda: f32) -> Self {
        Self { gpu, pool: Arc::default(), lambda }
    }

    fn scratch(&self, pixels: usize, groups: usize) -> Result<Lease<LossScratch>, GpuError> {
        let make = || {
            Ok(LossScratch {
                moments: self.gpu.allocate("SSIM moments", 9 * pixels)?,
                partials: self.gpu.allocate("loss sums", groups)?,
                stats: self.gpu.allocate("loss statistics", 4)?,
                pixels,
                groups,
            })
        };
        self.pool.lease_or(|scratch| scratch.pixels >= pixels && scratch.groups >= groups, make)
    }

    fn forward(&self, image: CubeTensor, target: &DevicePhoto) -> Result<(CubeTensor, Saved), GpuError> {
        let gpu = &*self.gpu;
        let [width, height] = target.size;
        assert_eq!(image.meta.shape()[..], [height as usize, width as usize, 3], "image and photo differ in size");
        let params = target.params(self.lambda);
        let tiles = params.tiles;
        let scratch = self.scratch((width * height) as usize, (3 * tiles[0] * tiles[1]) as usize)?;
        let loss = empty_like(&image, &[1]);
        let (bound_image, bound_loss) = (bind(&image), bind(&loss));
        let mut pass = Pass::new(gpu, "image loss");
        let LossScratch { moments, partials, stats, .. } = &*scratch;
        let buffers = ImageLossBindings { image: &bound_image, photo: &target.texels, moments, partials };
        pass.grid(&buffers, &params, [tiles[0], tiles[1], 3]);
        pass.grid(&ImageLossTotalBindings { partials, loss: &bound_loss, stats }, &params, [1, 1, 1]);
        pass.submit();
        let (gpu, target, scratch) = (self.gpu.clone(), target.clone(), Arc::new(scratch));
        let saved = Saved { gpu, image, target, params, scratch };
        Ok((loss, saved))
    }

    /// Loss `[1]` of a tracked image `[H, W, 3]` on the autodiff graph, and the scratch that holds its statistics.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// When image and photo differ in size, or the image is not on the autodiff graph: bugs of ours.
    pub fn tracked(
        &self,
        image: Tensor<3>,
        target: &DevicePhoto,
    ) -> Result<(Tensor<1>, Arc<Lease<LossScratch>>), GpuError> {
        let mut scratch = None;
        let loss = unary(image, |image| {
            let (loss, saved) = self.forward(image, target)?;
            scratch = Some(saved.scratch.clone());
            Ok::<_, GpuError>((loss, move |v_loss: &CubeTensor| Some(saved.backward(v_loss))))
        })?;
        Ok((loss, scratch.expect("the loss was computed")))
    }
}
