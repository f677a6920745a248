//! The images of one member of an ensemble, and those of all.

use super::frame::FinalImage;
use super::image_part::{Sources, record_final};
use super::{Frame, Renderer};
use crate::camera::Camera;
use crate::ensemble::{record_weighted_sum, weights};
use crate::exposure::Exposures;
use crate::gpu::{Buffer, GpuError, Pass};
use crate::raster::{Forward, Keep, RasterView, Room};
use std::iter;

/// What a member reads of a view, made before its images are recorded.
pub(super) struct Prepared {
    view: RasterView,
    /// None without an image-based part.
    sources: Option<Sources>,
    exposures: Option<Exposures>,
}

/// Images that are being recorded.
pub(super) struct Images {
    /// The pass of the Gaussians.
    pub forward: Forward,
    /// The base image, `[H, W, 3]`.
    pub base: Buffer<f32>,
    /// The final image, of a model with a network.
    pub image: Option<FinalImage>,
}

impl Renderer {
    /// Makes what this member, without the others, reads of a view of a camera in the scene.
    pub(super) fn prepare(&self, camera: &Camera, room: Room) -> Result<Prepared, GpuError> {
        // The sources' depth maps first: what they were made in then serves the frame.
        let sources = self.image.as_ref().map(|stage| self.sources(stage, camera, room)).transpose()?;
        let indices = sources.as_ref().map_or(&[][..], |sources| &sources.indices[..]);
        let exposures = self.exposures(camera, indices)?;
        Ok(Prepared { view: self.view(&self.space().camera(camera)), sources, exposures })
    }

    /// Records the images of this member alone.
    pub(super) fn record_own(&self, pass: &mut Pass, prepared: &Prepared) -> Result<Images, GpuError> {
        let Prepared { view, sources, exposures } = prepared;
        let memory = self.raster.image_memory(&view.camera)?;
        let forward = self.raster.record(pass, &self.splats, view, Keep::Image, memory)?;
        let base = match exposures {
            Some(exposures) => {
                let exposed = self.gpu().transient("exposed image", forward.image.rows())?;
                exposures.record(pass, &forward, &exposed);
                exposed
            }
            None => forward.image.clone(),
        };
        let image = match (&self.image, sources) {
            (Some(stage), Some(sources)) => {
                let given = (base.clone(), exposures.as_ref());
                Some(record_final(pass, (self.gpu(), stage), &view.camera, &forward, given, sources)?)
            }
            _ => None,
        };
        Ok(Images { forward, base, image })
    }

    /// Records the images of an ensemble, and the passes of its further members: the mean of the base images, and over it that of
    /// the residuals.
    pub(super) fn record_all(
        &self,
        pass: &mut Pass,
        (own, members): (&Prepared, &[Prepared]),
    ) -> Result<(Images, Vec<Forward>), GpuError> {
        let mut first = self.record_own(pass, own)?;
        if self.members.is_empty() {
            return Ok((first, Vec::new()));
        }
        let [alike, other] = weights(self.alike, 1 + self.members.len() - self.alike);
        let mut bases = vec![(alike, first.base.clone())];
        let mut residuals: Vec<_> = first.image.iter().map(|image| [image.image.clone(), first.base.clone()]).collect();
        let mut others = Vec::new();
        for ((member, prepared), number) in self.members.iter().zip(members).zip(1..) {
            let Images { forward, base, image } = member.record_own(pass, prepared)?;
            bases.push((if number < self.alike { alike } else { other }, base.clone()));
            if let Some(image) = image {
                residuals.push([image.image.clone(), base]);
                pass.keep(image);
            }
            others.push(forward);
        }
        let values = 3 * own.view.camera.pixels();
        first.base = self.record_total(pass, values, bases)?;
        if let Some(image) = &mut first.image {
            let part = 1.0 / residuals.len() as f32;
            let differences = residuals.into_iter().flat_map(|[image, base]| [(part, image), (-part, base)]);
            let terms = iter::once((1.0, first.base.clone())).chain(differences);
            image.image = self.record_total(pass, values, terms)?;
        }
        Ok((first, others))
    }

    /// Records the weighted sum of images, two at least.
    fn record_total(
        &self,
        pass: &mut Pass,
        values: usize,
        terms: impl IntoIterator<Item = (f32, Buffer<f32>)>,
    ) -> Result<Buffer<f32>, GpuError> {
        let mut terms = terms.into_iter();
        let mut total = terms.next().expect("a sum has terms");
        for (weight, image) in terms {
            let sum = self.gpu().transient("sum of images", values)?;
            record_weighted_sum(pass, values, [(total.0, &total.1), (weight, &image)], &sum);
            pass.keep([total.1, image]);
            total = (1.0, sum);
        }
        Ok(total.1)
    }

    /// Whether every tile intersection of a frame fitted. What else is known of it on the device alone comes with the answer.
    pub(super) async fn had_room_async(&self, frame: &mut Frame) -> Result<bool, GpuError> {
        let forwards: Vec<_> = iter::once(&frame.forward).chain(&frame.others).collect();
        let counts = forwards.iter().map(|forward| &forward.workspace.total);
        let all: Vec<_> = counts.chain(frame.seen().map(|seen| &seen.most_visible)).collect();
        let words = self.gpu().read_firsts_async(&all).await?;
        let mut fits = true;
        for ((member, forward), &needed) in self.all().zip(&forwards).zip(&words) {
            fits &= member.raster.fitted(&forward.frame, needed.into());
        }
        let most_visible = words.get(forwards.len()).copied();
        // A view without sources sees none.
        frame.most_visible = frame.image.is_some().then(|| most_visible.unwrap_or(0));
        Ok(fits)
    }
}
