//! Photos of a model that has lost Gaussians: what shows these is hidden.

use super::{Renderer, render_base};
use crate::camera::Camera;
use crate::dataset::{HostPhoto, Photo};
use crate::gpu::GpuError;
use crate::lru::Lru;
use crate::raster::Rasterizer;
use crate::scene::{Gaussians, Splats};
use crate::sources::DevicePhoto;
use crate::sources::source_store::pixels;
use std::sync::{Arc, Mutex};

/// A pixel shows what was removed where more than this part of its light comes from there. Half would leave the rim of an object,
/// whose pixels are a mixture.
const MOST: f32 = 0.25;

/// What was removed from a model, whose photos still show it.
#[derive(Debug)]
pub struct Removed {
    raster: Arc<Rasterizer>,
    /// All Gaussians of each base: white ones were removed, black ones are left.
    marked: Vec<Splats>,
    /// The photos of training views where pixels are hidden, those used last; none where no pixel is.
    photos: Mutex<Lru<Option<SourcePhoto>>>,
}

/// A photo of a source, on the device and on the host.
pub(super) type SourcePhoto = (DevicePhoto, HostPhoto);

impl Removed {
    /// The photo of a camera in the scene with alpha 0 where it shows what was removed, in the mean over the bases; none where no
    /// pixel does.
    ///
    /// # Errors
    /// Not enough memory, the device is lost, or the photo cannot be decoded again.
    pub fn hide(&self, camera: &Camera, photo: &HostPhoto) -> Result<Option<Photo>, GpuError> {
        let mut parts = vec![0.0; camera.pixels()];
        for marked in &self.marked {
            let image = render_base(&self.raster, marked, camera)?;
            parts.iter_mut().zip(image.rgb.as_chunks::<3>().0).for_each(|(part, [red, ..])| *part += red);
        }
        let most = MOST * self.marked.len() as f32;
        if parts.iter().all(|part| *part <= most) {
            return Ok(None);
        }
        let mut photo = Arc::unwrap_or_clone(pixels(photo)?);
        let texels = photo.rgba.as_chunks_mut::<4>().0.iter_mut();
        texels.zip(parts).filter(|(_, part)| *part > most).for_each(|(texel, _)| texel[3] = 0);
        Ok(Some(photo))
    }

    /// The photo of training view `index` with that hidden.
    pub(super) fn source(
        &self,
        index: usize,
        camera: &Camera,
        (device, host): SourcePhoto,
    ) -> Result<SourcePhoto, GpuError> {
        let mut photos = self.photos.lock().expect("photos of an edited model");
        if let Some(found) = photos.get(index) {
            return Ok(found.clone().unwrap_or((device, host)));
        }
        let hidden = match self.hide(camera, &host)? {
            Some(photo) => Some((DevicePhoto::upload(self.raster.gpu(), &photo)?, photo.into())),
            None => None,
        };
        let bytes = hidden.as_ref().map_or(0, |(device, _)| device.texels.bytes());
        photos.make_room(bytes);
        photos.insert(index, hidden.clone(), bytes);
        Ok(hidden.unwrap_or((device, host)))
    }
}

impl Renderer {
    /// What was removed from this model, of which these are all Gaussians of each base: white ones were removed, black ones are left.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn removed(&self, marked: &[Gaussians]) -> Result<Removed, GpuError> {
        let budget = self.part().and_then(|part| self.gpu().bytes_of(part.options.sources.memory));
        let marked = marked.iter().map(|base| Splats::upload(base, self.gpu())).collect::<Result<_, _>>()?;
        Ok(Removed { raster: self.raster.clone(), marked, photos: Mutex::new(Lru::new(budget)) })
    }

    /// Reads no pixel of a photo that shows what was removed, in this member of an ensemble.
    pub fn hiding(mut self, removed: Option<Arc<Removed>>) -> Self {
        if let Some(stage) = &mut self.image {
            stage.removed = removed;
        }
        self
    }
}
