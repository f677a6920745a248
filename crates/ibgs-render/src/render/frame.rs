//! A rendered view: its images and its surface, on the device and read back.

use crate::camera::Camera;
use crate::dataset::HostPhoto;
use crate::gpu::pool::Lease;
use crate::gpu::{Buffer, Gpu, GpuError, at_once};
use crate::local_space::LocalSpace;
use crate::raster::{Forward, Surface};
use crate::sources::{Seen, WarpOptions};
use ibgs_shaders::NEAR_DEPTH;
use std::sync::Arc;

/// An image on the host.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// RGB, row by row, not clamped.
    pub rgb: Vec<f32>,
}

impl Rendered {
    /// Clamped and rounded to 8 bits a channel.
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.rgb.iter().map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect()
    }
}

/// What a frame keeps of one of its sources.
#[derive(Debug)]
pub(crate) struct FrameSource {
    /// Index of the training view.
    pub view: usize,
    pub camera: Camera,
    pub photo: HostPhoto,
    /// The view's own median depth, `[H * W]`.
    pub depth: Buffer<f32>,
}

/// The final image and what it was made from.
#[derive(Debug)]
pub(crate) struct FinalImage {
    /// `[H, W, 3]`.
    pub image: Buffer<f32>,
    /// Which sources its pixels see; none without any source.
    pub seen: Option<Arc<Lease<Seen>>>,
    /// Its sources, best first.
    pub sources: Vec<FrameSource>,
    /// How they were warped.
    pub options: WarpOptions,
}

/// A rendered view, still on the device.
#[derive(Debug)]
pub struct Frame {
    pub(crate) gpu: Arc<Gpu>,
    pub(super) forward: Forward,
    /// The passes of the other members of an ensemble.
    pub(super) others: Vec<Forward>,
    /// The final image, where the model has a network.
    pub(crate) image: Option<FinalImage>,
    /// The base image, `[H, W, 3]`.
    pub(super) base: Buffer<f32>,
    pub(super) camera: Camera,
    /// In local coordinates.
    pub(crate) local: Camera,
    pub(crate) space: LocalSpace,
    /// See [`Frame::most_visible`].
    pub(super) most_visible: Option<u32>,
}

impl Frame {
    /// The camera, in the scene's coordinates.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The base image, on the device, `[H, W, 3]`.
    pub(crate) fn base_memory(&self) -> &Buffer<f32> {
        &self.base
    }

    /// The final image, on the device, `[H, W, 3]`.
    pub(crate) fn image_memory(&self) -> Option<&Buffer<f32>> {
        self.image.as_ref().map(|part| &part.image)
    }

    /// The sources that the pixels see, on the device.
    pub(crate) fn seen(&self) -> Option<&Seen> {
        self.image.as_ref()?.seen.as_ref().map(|seen| &***seen)
    }

    /// The surface, on the device.
    pub(crate) fn surface(&self) -> Option<&Surface> {
        self.forward.surface().map(|surface| &***surface)
    }

    /// Depth in scene units up to which nothing is drawn.
    pub fn near_depth(&self) -> f64 {
        f64::from(NEAR_DEPTH) * self.space.scale
    }

    /// Median depth at a pixel in scene units; none where nothing is met or no surface was asked for.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn depth_at(&self, x: u32, y: u32) -> Result<Option<f32>, GpuError> {
        let Some(surface) = self.surface().filter(|_| x < self.camera.width && y < self.camera.height) else {
            return Ok(None);
        };
        let at = y as usize * self.camera.width as usize + x as usize;
        let depth = at_once(self.gpu.read_at_async(&surface.median_depth, at, 1))?[0];
        Ok(Some(depth).filter(|&z| z > 0.0 && z.is_finite()).map(|z| self.in_scene_units(z)))
    }

    /// A local length.
    pub(crate) fn in_scene_units(&self, length: f32) -> f32 {
        (f64::from(length) * self.space.scale) as f32
    }

    fn pixels(&self) -> usize {
        (self.camera.width * self.camera.height) as usize
    }

    /// The base image.
    ///
    /// # Errors
    /// When the device is lost; so with the others.
    pub fn base(&self) -> Result<Rendered, GpuError> {
        self.read(&self.base)
    }

    /// The final image; none where the model has no network.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn image(&self) -> Result<Option<Rendered>, GpuError> {
        self.image_memory().map(|memory| self.read(memory)).transpose()
    }

    fn read(&self, memory: &Buffer<f32>) -> Result<Rendered, GpuError> {
        at_once(self.read_async(memory))
    }

    /// As [`Frame::base`], for browsers.
    ///
    /// # Errors
    /// When the device is lost.
    pub async fn base_async(&self) -> Result<Rendered, GpuError> {
        self.read_async(&self.base).await
    }

    /// As [`Frame::image`], for browsers.
    ///
    /// # Errors
    /// When the device is lost.
    pub async fn image_async(&self) -> Result<Option<Rendered>, GpuError> {
        match self.image_memory() {
            Some(memory) => self.read_async(memory).await.map(Some),
            None => Ok(None),
        }
    }

    async fn read_async(&self, memory: &Buffer<f32>) -> Result<Rendered, GpuError> {
        let Camera { width, height, .. } = self.camera;
        Ok(Rendered { width, height, rgb: self.gpu.read_async(memory, 3 * self.pixels()).await? })
    }

    /// Median depth in scene units, `[H * W]`, 0 where nothing is met; none where no surface was asked for.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn depth(&self) -> Result<Option<Vec<f32>>, GpuError> {
        at_once(self.depth_async())
    }

    /// As [`Frame::depth`], for browsers.
    ///
    /// # Errors
    /// When the device is lost.
    pub async fn depth_async(&self) -> Result<Option<Vec<f32>>, GpuError> {
        let Some(surface) = self.forward.surface() else { return Ok(None) };
        let mut depth = self.gpu.read_async(&surface.median_depth, self.pixels()).await?;
        depth.iter_mut().for_each(|z| *z = self.in_scene_units(*z));
        Ok(Some(depth))
    }

    /// Normal map in camera space, `[H * W * 3]`, not normalised; none where no surface was asked for.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn normals(&self) -> Result<Option<Vec<f32>>, GpuError> {
        self.forward.surface().map(|surface| self.gpu.read(&surface.normal_map, 3 * self.pixels())).transpose()
    }

    /// The largest number of sources that any pixel sees; none where the model has no network, or nothing was waited for
    /// ([`Renderer::render_unchecked`](super::Renderer::render_unchecked)).
    pub fn most_visible(&self) -> Option<u32> {
        self.most_visible
    }

    /// How many sources are used at each pixel, `[H * W]`; none where the model has no network.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn visibility(&self) -> Result<Option<Vec<u32>>, GpuError> {
        let Some(part) = &self.image else { return Ok(None) };
        let Some(seen) = &part.seen else { return Ok(Some(vec![0; self.pixels()])) };
        let packed = self.gpu.read(&seen.visible, self.pixels())?;
        let count = |word: u32| (0..4).filter(|m| (word >> (8 * m)) & 255 != 255).count() as u32;
        Ok(Some(packed.into_iter().map(count).collect()))
    }
}
