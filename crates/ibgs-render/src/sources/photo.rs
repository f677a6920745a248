//! Photos on the device.

use crate::dataset::Photo;
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_shaders::TILE;
use ibgs_shaders::types::LossParams;
use std::ops::Range;
use std::sync::Arc;

/// What lies outside of a photo's mask, for the image loss; the other losses leave pixels with alpha under one half out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Outside {
    /// Anything: pixels with alpha under one half leave the loss.
    #[default]
    Unknown,
    /// Nothing: the photo lies over this colour, by as much as its alpha says
    /// ([`ALPHA_EMPTY`](ibgs_shaders::ALPHA_EMPTY) to 255); pixels with alpha 0 leave the loss.
    Background([f32; 3]),
}

/// A photo on the device: RGBA, one byte a channel.
#[derive(Clone, Debug)]
pub struct DevicePhoto {
    /// One `u32` a pixel, red in the lowest byte.
    pub texels: Buffer<u32>,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// What lies outside of its mask.
    pub outside: Outside,
    /// Counts the clones: a store does not give the memory to another photo while there is one.
    pub(crate) held: Arc<()>,
}

impl DevicePhoto {
    /// Uploads a photo.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn upload(gpu: &Gpu, photo: &Photo) -> Result<Self, GpuError> {
        let bytes = gpu.upload("photo", &photo.rgba)?;
        Ok(Self::new(bytes.cast(), [photo.width, photo.height]))
    }

    /// Texels that are on the device, and the size of the photo they make.
    pub(crate) fn new(texels: Buffer<u32>, size: [u32; 2]) -> Self {
        Self { texels, size, outside: Outside::default(), held: Arc::default() }
    }

    /// Some of its rows, copied.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn of_rows(&self, gpu: &Gpu, pass: &mut Pass, rows: &Range<u32>) -> Result<Self, GpuError> {
        let width = self.size[0] as usize;
        let count = width * rows.len();
        let texels = gpu.transient("rows of a photo", count)?;
        pass.copy(&self.texels.part(width * rows.start as usize, count), &texels, 0, count);
        Ok(Self { outside: self.outside, ..Self::new(texels, [self.size[0], rows.len() as u32]) })
    }

    /// What a kernel that compares with it needs.
    pub fn params(&self, lambda: f32) -> LossParams {
        let background = match self.outside {
            Outside::Unknown => None,
            Outside::Background(color) => Some(color),
        };
        LossParams {
            size: self.size,
            tiles: self.size.map(|n| n.div_ceil(TILE)),
            background: background.unwrap_or_default(),
            object: u32::from(background.is_some()),
            lambda,
            ..LossParams::default()
        }
    }
}
