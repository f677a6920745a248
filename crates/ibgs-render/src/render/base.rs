//! The base image: that of the Gaussians, or the mean of those of an ensemble's members.

use super::frame::FinalImage;
use super::{Frame, Renderer};
use crate::camera::Camera;
use crate::ensemble::record_weighted_sum;
use crate::exposure::Exposures;
use crate::gpu::{Buffer, GpuError, Pass};
use crate::raster::{Forward, Keep, RasterView};

/// A base image that is being recorded.
pub(super) struct Base {
    /// The pass of the first member.
    pub forward: Forward,
    /// Those of the others.
    pub others: Vec<Forward>,
    /// `[H, W, 3]`.
    pub image: Buffer<f32>,
}

impl Renderer {
    /// Records the base image of these Gaussians alone.
    pub(super) fn record_own(
        &self,
        pass: &mut Pass,
        view: &RasterView,
        exposures: Option<&Exposures>,
    ) -> Result<Base, GpuError> {
        let memory = self.raster.image_memory(&view.camera)?;
        let forward = self.raster.record(pass, &self.splats, view, Keep::Image, memory)?;
        let image = match exposures {
            Some(exposures) => {
                let exposed = self.gpu().transient("exposed image", forward.image.rows())?;
                exposures.record(pass, &forward, &exposed);
                exposed
            }
            None => forward.image.clone(),
        };
        Ok(Base { forward, others: Vec::new(), image })
    }

    /// Records the mean of the base image of these Gaussians and those of the other members, and lays the residual of the final
    /// image over it.
    pub(super) fn record_members(
        &self,
        pass: &mut Pass,
        camera: &Camera,
        (own, image): (Base, Option<&mut FinalImage>),
    ) -> Result<Base, GpuError> {
        if self.members.is_empty() {
            return Ok(own);
        }
        let (mut base, values) = (own, 3 * camera.pixels());
        let first = base.image.clone();
        for (member, images) in self.members.iter().zip(1..) {
            let view = member.view(&member.space().camera(camera));
            let exposures = member.exposures(camera, &[])?;
            let Base { forward, image, .. } = member.record_own(pass, &view, exposures.as_ref())?;
            let part = 1.0 / (images as f32 + 1.0);
            base.image = self.record_sum(pass, values, [(1.0 - part, &base.image), (part, &image)])?;
            base.others.push(forward);
        }
        if let Some(image) = image {
            let change = self.record_sum(pass, values, [(1.0, &base.image), (-1.0, &first)])?;
            image.image = self.record_sum(pass, values, [(1.0, &image.image), (1.0, &change)])?;
        }
        Ok(base)
    }

    fn record_sum(
        &self,
        pass: &mut Pass,
        values: usize,
        images: [(f32, &Buffer<f32>); 2],
    ) -> Result<Buffer<f32>, GpuError> {
        let sum = self.gpu().transient("sum of images", values)?;
        record_weighted_sum(pass, values, images, &sum);
        pass.keep(images.map(|(_, image)| image.clone()));
        Ok(sum)
    }

    /// Whether every tile intersection of a frame fitted.
    pub(super) fn had_room(&self, frame: &Frame) -> Result<bool, GpuError> {
        let mut all = self.raster.had_room(&frame.forward)?;
        for (member, forward) in self.members.iter().zip(&frame.others) {
            all &= member.raster.had_room(forward)?;
        }
        Ok(all)
    }

    /// As [`Renderer::had_room`], for browsers.
    pub(super) async fn had_room_async(&self, frame: &Frame) -> Result<bool, GpuError> {
        let mut all = self.raster.had_room_async(&frame.forward).await?;
        for (member, forward) in self.members.iter().zip(&frame.others) {
            all &= member.raster.had_room_async(forward).await?;
        }
        Ok(all)
    }
}
