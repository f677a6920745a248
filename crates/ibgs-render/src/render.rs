//! [`Renderer`]: the one path that training, render, eval and the viewer use. Its cameras, and the depths of its frames, are in the
//! scene's coordinates; on the device all is local ([`LocalSpace`]).

mod base;
mod frame;
mod image_part;
mod photo_errors;
mod removed;

pub(crate) use frame::FrameSource;
pub use frame::{Frame, Rendered};
pub use image_part::{ImageOptions, ImagePart};
pub use photo_errors::PhotoErrors;
pub use removed::Removed;

use crate::camera::Camera;
use crate::exposure::{ExposureField, ExposurePass, Exposures};
use crate::gpu::{Gpu, GpuError, Pass, at_once};
use crate::levels::Stream;
use crate::local_space::LocalSpace;
use crate::raster::{RasterView, Rasterizer, Room, Shape, SurfaceOptions};
use crate::residual::Residual;
use crate::scene::{SceneError, Splats};
use crate::sources::SourceView;
use base::Images;
use image_part::{ImageStage, Sources};
use std::sync::{Arc, Mutex, PoisonError};

/// Renders a model.
#[derive(Debug)]
pub struct Renderer {
    raster: Arc<Rasterizer>,
    splats: Splats,
    background: Mutex<[f32; 3]>,
    /// Find the surface of models that do not need it for their image.
    shows_surface: bool,
    shape: Shape,
    image: Option<ImageStage>,
    /// The exposures of its photos, where they were corrected.
    exposure: Option<(ExposureField, ExposurePass)>,
    /// Chunks that come and go with the views, of a model with levels of detail.
    stream: Option<Stream>,
    /// The others of an ensemble, which give their images.
    members: Arc<[Renderer]>,
    /// How many members have the weight of the first in the base image: it and the first of the others.
    alike: usize,
}

impl Renderer {
    /// A renderer of Gaussians, with the image-based part where there is one.
    pub fn new(raster: Arc<Rasterizer>, splats: Splats, background: [f32; 3], part: Option<ImagePart>) -> Self {
        let gpu = raster.gpu().clone();
        let stage = |part: ImagePart| {
            let residual = Residual::new(gpu.clone(), part.options.variant, part.options.precision);
            ImageStage::new(&gpu, part, residual)
        };
        Self {
            image: part.map(stage),
            raster,
            splats,
            background: Mutex::new(background),
            shows_surface: false,
            shape: Shape::default(),
            exposure: None,
            stream: None,
            members: Arc::default(),
            alike: 1,
        }
    }

    /// The same renderer of other Gaussians in the same space; both share photos, network and scratch memory.
    pub fn with_splats(&self, splats: Splats) -> Self {
        let gpu = self.gpu();
        let stage = |stage: &ImageStage| ImageStage {
            removed: stage.removed.clone(),
            ..ImageStage::new(gpu, stage.part.clone(), stage.residual.clone())
        };
        Self {
            raster: self.raster.clone(),
            splats,
            background: Mutex::new(self.background()),
            shows_surface: self.shows_surface,
            shape: self.shape,
            image: self.image.as_ref().map(stage),
            exposure: self.exposure().map(|field| (field.clone(), ExposurePass::new(gpu.clone()))),
            stream: None,
            members: self.members.clone(),
            alike: self.alike,
        }
    }

    /// A renderer of the centres of the Gaussians alone, as opaque points of their colours.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn of_points(&self) -> Result<Self, GpuError> {
        let splats = self.splats.as_points(self.gpu())?;
        Ok(Self::new(self.raster.clone(), splats, self.background(), None))
    }

    /// A renderer of the Gaussians as opaque ellipsoids with hard edges.
    pub fn of_ellipsoids(&self) -> Self {
        let plain = Self::new(self.raster.clone(), self.splats.clone(), self.background(), None);
        Self { shape: Shape::Ellipsoids, ..plain }
    }

    /// Every view in the exposure that is predicted from its neighbours. Those of the image-based part's cameras must come in their order.
    pub fn with_exposure(self, field: Option<ExposureField>) -> Self {
        let exposure = field.map(|field| (field, ExposurePass::new(self.gpu().clone())));
        Self { exposure, ..self }
    }

    /// The same of Gaussians that are the chunks of a model with levels of detail.
    pub fn with_stream(self, stream: Stream) -> Self {
        Self { stream: Some(stream), ..self }
    }

    /// The first member of an ensemble, with the others: the base image is the weighted mean of all, in which the first `alike`, 1
    /// at least, have one weight and the rest another ([`weights`](crate::ensemble::weights)). Over it lies the mean of the
    /// residuals; the surface is that of the first.
    pub fn with_members(self, members: Vec<Self>, alike: usize) -> Self {
        Self { alike: alike.clamp(1, 1 + members.len()), members: members.into(), ..self }
    }

    /// The colour behind the Gaussians.
    pub fn background(&self) -> [f32; 3] {
        *self.background.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Another colour behind the Gaussians of all members, from the next frame on.
    pub fn set_background(&self, color: [f32; 3]) {
        *self.background.lock().unwrap_or_else(PoisonError::into_inner) = color;
        self.members.iter().for_each(|member| member.set_background(color));
    }

    /// The other members of its ensemble.
    pub fn members(&self) -> &[Self] {
        &self.members
    }

    /// It and the other members of its ensemble.
    fn all(&self) -> impl Iterator<Item = &Self> {
        std::iter::once(self).chain(self.members.iter())
    }

    /// How many members of its ensemble have the weight of the first.
    pub fn alike(&self) -> usize {
        self.alike
    }

    /// Brings all chunks of a view, of a model with levels of detail whose frames do not wait for them.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn complete(&self, camera: &Camera) -> Result<(), GpuError> {
        if let Some(stream) = &self.stream
            && stream.complete(self.gpu(), &self.splats, &self.space().camera(camera))?
        {
            self.forget_depths();
        }
        Ok(())
    }

    /// The chunks on the device, of a model with levels of detail that is larger.
    pub fn stream(&self) -> Option<&Stream> {
        self.stream.as_ref()
    }

    /// Every view in the photos' mean exposure, without a prediction.
    pub fn levelled(self) -> Self {
        let members = self.members.iter().map(|member| member.with_splats(member.splats.clone()).levelled()).collect();
        let exposure = self.exposure.map(|(field, exposure_pass)| (field.levelled(), exposure_pass));
        Self { exposure, members, ..self }
    }

    /// The exposures of the photos, where they were corrected.
    pub fn exposure(&self) -> Option<&ExposureField> {
        self.exposure.as_ref().map(|(field, _)| field)
    }

    /// Depth and normals of every frame, also of a model without an image-based part.
    pub fn showing_surface(self) -> Self {
        Self { shows_surface: true, ..self }
    }

    /// Gives every Gaussian the plane of its shortest axis where none was ever trained (method.md section 1), so that depths
    /// mean something.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn shape_missing_planes(&self) -> Result<(), SceneError> {
        // Those of a model with levels of detail have been shaped when its bundle was written.
        if self.stream.is_none() && self.splats.download(self.gpu())?.lacks_planes() {
            self.shape_planes();
        }
        Ok(())
    }

    /// Sets all planes: normals to the Gaussians' shortest axes, offsets to 0.
    pub fn shape_planes(&self) {
        self.raster.shape_normals(&self.splats);
        self.forget_depths();
    }

    /// The GPU it works on.
    pub fn gpu(&self) -> &Arc<Gpu> {
        self.raster.gpu()
    }

    /// The Gaussians.
    pub fn splats(&self) -> &Splats {
        &self.splats
    }

    /// The image-based part.
    pub fn part(&self) -> Option<&ImagePart> {
        self.image.as_ref().map(|stage| &stage.part)
    }

    /// Forgets the sources' median depths.
    pub fn forget_depths(&self) {
        if let Some(stage) = &self.image {
            stage.depths.lock().expect("depth cache").clear();
        }
        self.members.iter().for_each(Self::forget_depths);
    }

    /// Where its local coordinates lie in the scene.
    pub fn space(&self) -> LocalSpace {
        self.splats.space
    }

    /// A view of a local camera.
    fn view(&self, camera: &Camera) -> RasterView {
        let mut view = RasterView::new(*camera, self.splats.sh_degree());
        (view.background, view.shape) = (self.background(), self.shape);
        view.surface = match &self.image {
            Some(stage) => Some(stage.part.options.surface),
            None => self.shows_surface.then(SurfaceOptions::default),
        };
        view
    }

    /// Renders a view of a camera in the scene and waits until it is certain that every tile intersection fitted.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    pub fn render(&self, camera: &Camera) -> Result<Frame, GpuError> {
        self.render_in(camera, Room::Checked, |_| Ok(()))
    }

    /// As [`Renderer::render`]; `then` hands work on the frame to the device before the one wait for both. It is called again
    /// where the frame has to be rendered again.
    ///
    /// # Errors
    /// Not enough memory, the device is lost, or what `then` finds.
    pub fn render_and(
        &self,
        camera: &Camera,
        then: impl FnMut(&Frame) -> Result<(), GpuError>,
    ) -> Result<Frame, GpuError> {
        self.render_in(camera, Room::Checked, then)
    }

    /// As [`Renderer::render`] without waiting: for timing and for viewers that have rendered about the same view before.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn render_unchecked(&self, camera: &Camera) -> Result<Frame, GpuError> {
        self.render_in(camera, Room::Assumed, |_| Ok(()))
    }

    /// As [`Renderer::render_and`], for browsers, where a program cannot wait for the GPU.
    ///
    /// # Errors
    /// Not enough memory, the device is lost, or what `then` finds.
    pub async fn render_async(
        &self,
        camera: &Camera,
        mut then: impl FnMut(&Frame) -> Result<(), GpuError>,
    ) -> Result<Frame, GpuError> {
        // A map that is made within a frame is not checked.
        for member in self.all() {
            member.make_depths_async(camera).await?;
        }
        loop {
            let mut frame = self.render_in(camera, Room::Assumed, &mut then)?;
            if self.had_room_async(&mut frame).await? {
                return Ok(frame);
            }
        }
    }

    /// Makes the depth maps of a view's sources that are not there yet.
    async fn make_depths_async(&self, camera: &Camera) -> Result<(), GpuError> {
        let Some(stage) = &self.image else { return Ok(()) };
        for index in self.chosen(stage, camera) {
            if stage.depths.lock().expect("depth cache").get(index).is_none() {
                let view = self.view(&self.space().camera(&stage.part.cameras[index]));
                let map = self.raster.depth_map_async(&self.splats, &view).await?;
                stage.depths.lock().expect("depth cache").insert(index, map);
            }
        }
        Ok(())
    }

    fn render_in(
        &self,
        camera: &Camera,
        room: Room,
        mut then: impl FnMut(&Frame) -> Result<(), GpuError>,
    ) -> Result<Frame, GpuError> {
        let gpu = self.gpu().clone();
        let space = self.space();
        let local = space.camera(camera);
        if let Some(stream) = &self.stream
            && stream.prepare(&gpu, &self.splats, &local)?
        {
            self.forget_depths();
        }
        let own = self.prepare(camera, room)?;
        let members = self.members.iter().map(|member| member.prepare(camera, room));
        let members = members.collect::<Result<Vec<_>, _>>()?;
        loop {
            let mut pass = Pass::new(&gpu, "frame");
            let (Images { forward, base, image }, others) = self.record_all(&mut pass, (&own, &members))?;
            pass.submit();
            let gpu = gpu.clone();
            let most_visible = None;
            let mut frame = Frame { gpu, forward, others, image, base, camera: *camera, local, space, most_visible };
            then(&frame)?;
            if room == Room::Assumed || at_once(self.had_room_async(&mut frame))? {
                return Ok(frame);
            }
        }
    }

    /// The exposures of a view and its sources; none where exposures were not corrected.
    fn exposures(&self, camera: &Camera, sources: &[usize]) -> Result<Option<Exposures>, GpuError> {
        let Some((field, exposure_pass)) = &self.exposure else { return Ok(None) };
        let sources: Vec<_> = sources.iter().map(|&source| field.photos()[source]).collect();
        Ok(Some(exposure_pass.upload(&field.at(camera), &sources)?))
    }

    /// Which training views are the sources of a view; none where it has none or is too small for the network.
    fn chosen(&self, stage: &ImageStage, camera: &Camera) -> Vec<usize> {
        // A training view is no source of itself, at any size.
        let own = stage.part.cameras.iter().position(|other| other.has_pose_of(camera));
        if stage.residual.fits(camera) { stage.finder.sources(camera, own) } else { Vec::new() }
    }

    /// The sources of a view, with their photos and depth maps.
    fn sources(&self, stage: &ImageStage, camera: &Camera, room: Room) -> Result<Sources, GpuError> {
        let chosen = self.chosen(stage, camera);
        let photos = stage.part.photos.photos(&chosen)?;
        let mut depths = stage.depths.lock().expect("depth cache");
        let source = |(&index, photo)| {
            let camera = &stage.part.cameras[index];
            let own = (photo, stage.part.photos.on_host(index).clone());
            let (photo, host) = match &stage.removed {
                Some(removed) => removed.source(index, camera, own)?,
                None => own,
            };
            let camera = self.space().camera(camera);
            let make = || self.raster.depth_map(&self.splats, &self.view(&camera), room);
            let depth = depths.get_or_make(index, make)?;
            Ok((SourceView { camera, photo, depth }, host))
        };
        let sources = chosen.iter().zip(photos).map(source).collect::<Result<Vec<_>, GpuError>>()?;
        let (views, photos) = sources.into_iter().unzip();
        Ok(Sources { indices: chosen, views, photos })
    }
}

/// The base image of Gaussians alone, from a camera in the scene.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn render_base(raster: &Rasterizer, splats: &Splats, camera: &Camera) -> Result<Rendered, GpuError> {
    let Camera { width, height, .. } = *camera;
    let image = raster.render(splats, &RasterView::new(splats.space.camera(camera), splats.sh_degree()))?;
    Ok(Rendered { width, height, rgb: raster.gpu().read(&image, 3 * camera.pixels())? })
}
