//! The rendered image on the screen: which frames are asked for, at which size, and the textures that egui paints.

use crate::looks::Look;
use crate::mode::{Mode, Style};
use crate::worker::{Rendered, Request, Sheet};
use eframe::egui::TextureId;
use eframe::egui_wgpu::RenderState;
use ibgs_core::camera::Camera;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::present::Presenter;
use ibgs_core::render::Frame;
use ibgs_core::sources::DevicePhoto;
use std::sync::Arc;
use std::time::Duration;
use web_time::Instant;

/// Longest time of a frame in seconds, while the camera moves and when it rests; a slower frame is rendered smaller.
const SLOW: [f32; 2] = [0.04, 2.0];
/// A frame is at least this share of the window's size.
const LEAST_SHARE: f32 = 0.125;
/// Share of the first frame, as nothing is known of the time yet.
const FIRST_SHARE: f32 = 0.25;
/// Shortest and longest side of an image in pixels.
pub(crate) const SIDES: [u32; 2] = [16, 8192];
/// Pictures with a side of no more pixels are not made smaller where the device has no room.
const SMALL: u32 = 64;
/// A model in training is rendered again after this time, and at least this many times the time of a frame.
const REFRESH: Duration = Duration::from_millis(100);
const REFRESH_FRAMES: u32 = 8;

/// What is wanted on the screen.
#[derive(Clone, Copy, Debug)]
pub struct CanvasRequest {
    /// The camera at the full size.
    pub camera: Camera,
    /// The camera moves: speed counts more than sharpness.
    pub moving: bool,
    /// The image is compared with a photo, so it must have its size.
    pub exact: bool,
    /// A resting camera's image has the full size, however long it takes.
    pub always_sharp: bool,
    /// The colour behind the Gaussians; none: that of the model.
    pub background: Option<[f32; 3]>,
    /// Depths are shown or selected by.
    pub with_range: bool,
    /// Looks that are shown.
    pub looks: [bool; Look::ALL.len()],
    /// Iteration of the training: another one is another model.
    pub iteration: u32,
    /// The training continues.
    pub running: bool,
}

struct Screen {
    texture: wgpu::Texture,
    id: TextureId,
    /// What it shows of the last frame.
    shown: Option<(Mode, Style, bool)>,
}

/// Asks for frames, and holds the last one and its textures.
pub struct Canvas {
    gpu: Arc<Gpu>,
    presenter: Presenter,
    screens: [Option<Screen>; 2],
    /// Where the picture of the awaited frame goes, which then changes places with the first screen.
    spare: Option<Screen>,
    last: Option<Rendered>,
    arrived: Option<Instant>,
    /// What was asked for and has not come yet, whether a smaller picture would do as well, and since when.
    awaited: Option<(Request, bool, Instant)>,
    /// What could not be rendered.
    refused: Option<Request>,
    /// Seconds of a frame over its pixels.
    pixel_time: Option<f32>,
    /// Pixels that the device has room for; as many as are wanted until it had none.
    most_pixels: f32,
    /// The last frame was the first of its kind. It compiled kernels and made depth maps, so its time says too much.
    is_first: bool,
    /// Nothing more has to be asked for.
    settled: bool,
    /// Range of the depths and the like.
    pub style: Style,
}

impl Canvas {
    /// A canvas without an image yet.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: Arc<Gpu>) -> Result<Self, GpuError> {
        Ok(Self {
            presenter: Presenter::new(gpu.clone())?,
            gpu,
            screens: [None, None],
            spare: None,
            last: None,
            arrived: None,
            awaited: None,
            refused: None,
            pixel_time: None,
            most_pixels: f32::INFINITY,
            is_first: false,
            settled: false,
            style: Style::default(),
        })
    }

    /// The last frame.
    pub fn last(&self) -> Option<&Rendered> {
        self.last.as_ref()
    }

    /// How long a frame has been awaited; until it comes the picture is the one before.
    pub fn waits(&self) -> Option<Duration> {
        self.awaited.map(|(_, _, since)| since.elapsed())
    }

    /// Forgets all frames, for another model.
    pub fn clear(&mut self) {
        (self.last, self.arrived, self.awaited, self.refused) = (None, None, None, None);
        (self.pixel_time, self.most_pixels, self.settled) = (None, f32::INFINITY, false);
        self.screens.iter_mut().chain([&mut self.spare]).flatten().for_each(|screen| screen.shown = None);
    }

    /// Gives up the requested frame: it will not arrive and is not requested again.
    pub fn give_up(&mut self) {
        self.refused = self.awaited.take().map(|(request, ..)| request);
    }

    /// Gives up the requested frame, for which the device has no room, and asks for smaller ones from now on. False where none
    /// would do.
    pub fn give_up_size(&mut self) -> bool {
        let shrinks = self.awaited.filter(|(_, can_shrink, _)| *can_shrink);
        if let Some((request, ..)) = shrinks {
            self.most_pixels = 0.5 * request.camera.pixels() as f32;
        }
        self.give_up();
        shrinks.is_some()
    }

    /// Takes a finished frame.
    pub fn take(&mut self, rendered: Rendered) {
        let Some((request, ..)) = self.awaited else { return };
        if request.camera != *rendered.frame.camera() {
            // Of what was open before.
            return;
        }
        self.awaited = None;
        if let Some(range) = rendered.range {
            self.style.depth_range = range;
        }
        let has_sources = |rendered: &Rendered| rendered.facts.sources.is_some();
        self.is_first = self.last.as_ref().is_none_or(|last| has_sources(last) != has_sources(&rendered));
        // The time is proportional to the number of pixels.
        self.pixel_time = Some(rendered.time.as_secs_f32() / request.camera.pixels() as f32);
        self.screens.iter_mut().flatten().for_each(|screen| screen.shown = None);
        if self.spare.as_ref().is_some_and(|spare| spare.shown.is_some()) {
            std::mem::swap(&mut self.spare, &mut self.screens[0]);
        }
        self.last = Some(rendered);
        self.arrived = Some(Instant::now());
    }

    /// The frame to ask for now, if any.
    pub fn request(&mut self, wanted: &CanvasRequest) -> Option<Request> {
        if self.awaited.is_some() {
            return None;
        }
        let full = &wanted.camera;
        let pixels = full.pixels() as f32;
        let share = match self.pixel_time {
            _ if wanted.exact || (wanted.always_sharp && !wanted.moving) => 1.0,
            Some(time) => {
                (SLOW[usize::from(!wanted.moving)] / (time * pixels).max(1e-5)).sqrt().clamp(LEAST_SHARE, 1.0)
            }
            None => FIRST_SHARE,
        };
        let share = if wanted.exact { share } else { share.min((self.most_pixels / pixels).sqrt()) };
        // A smaller image than the full one is never chosen by the time of a first frame alone.
        let is_timed = !self.is_first || wanted.running || share >= 1.0;
        // What is sharp enough stays as it is: the time of a frame is never twice the same.
        let enough = |last: &Rendered| {
            let camera = last.frame.camera();
            let now = camera.width as f32 / full.width as f32;
            sees_the_same(camera, full) && now > 0.8 * share && now < 1.25 * share && share < 1.0
        };
        let side = |side: u32| ((side as f32 * share).round() as u32).clamp(SIDES[0], SIDES[1]);
        let camera = match &self.last {
            Some(last) if !wanted.moving && is_timed && enough(last) => *last.frame.camera(),
            _ if share < 1.0 => full.resized(side(full.width), side(full.height)),
            _ => *full,
        };
        let with_range = wanted.with_range && !wanted.moving;
        let fits = self.last.as_ref().is_some_and(|last| {
            let aged =
                !wanted.running || self.arrived.is_none_or(|at| at.elapsed() > REFRESH.max(last.time * REFRESH_FRAMES));
            *last.frame.camera() == camera
                && is_timed
                && last.background == wanted.background
                && !last.facts.is_loading
                && (last.range.is_some() || !with_range)
                && last.looks.iter().zip(wanted.looks).all(|(frame, wanted)| frame.is_some() || !wanted)
                && !(last.iteration != wanted.iteration && aged)
        });
        let request = (!fits)
            .then_some(Request { camera, with_range, looks: wanted.looks, background: wanted.background })
            .filter(|wanted| self.refused != Some(*wanted));
        let can_shrink = !wanted.exact && camera.width.min(camera.height) > SMALL;
        self.awaited = request.map(|request| (request, can_shrink, Instant::now()));
        let is_newest = wanted.running || self.last.as_ref().is_some_and(|last| last.iteration == wanted.iteration);
        self.settled = fits && is_newest && !wanted.moving;
        request
    }

    /// Where the picture of a requested frame goes; nowhere yet in modes that need a photo.
    pub fn sheet(&mut self, state: &RenderState, request: &Request, mode: Mode) -> Option<Sheet> {
        let camera = &request.camera;
        let screen = fitted(&self.gpu, state, &mut self.spare, [camera.width, camera.height]);
        screen.shown = (!mode.needs_photo()).then_some((mode, self.style, false));
        let texture = screen.shown.map(|_| screen.texture.clone())?;
        Some(Sheet { texture, mode, style: self.style })
    }

    /// Whether there was nothing left to request when requests were last considered.
    pub fn is_settled(&self) -> bool {
        self.settled
    }

    /// A texture that shows the last frame in a mode; two can be had at once.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn texture(
        &mut self,
        state: &RenderState,
        side: usize,
        mode: Mode,
        photo: Option<&DevicePhoto>,
    ) -> Result<Option<TextureId>, GpuError> {
        let Some(last) = &self.last else { return Ok(None) };
        let camera = last.frame.camera();
        let size = [camera.width, camera.height];
        let photo = photo.filter(|photo| photo.size == size);
        let screen = fitted(&self.gpu, state, &mut self.screens[side], size);
        let now = (mode, self.style, mode.needs_photo() && photo.is_some());
        if screen.shown != Some(now) {
            // Until the look arrives, the previous picture stays.
            let Some(frame) = frame_of(last, mode) else { return Ok(screen.shown.map(|_| screen.id)) };
            self.presenter.present(frame, &mode.shown(&self.style, photo), &screen.texture)?;
            screen.shown = Some(now);
        }
        Ok(Some(screen.id))
    }

    /// The last frame in a mode, on the host: width, height, RGB.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    pub fn picture(
        &mut self,
        mode: Mode,
        photo: Option<&DevicePhoto>,
    ) -> Result<Option<(u32, u32, Vec<u8>)>, GpuError> {
        let Some(last) = &self.last else { return Ok(None) };
        let camera = last.frame.camera();
        let photo = photo.filter(|photo| photo.size == [camera.width, camera.height]);
        let Some(frame) = frame_of(last, mode) else { return Ok(None) };
        let rgb = self.presenter.picture(frame, &mode.shown(&self.style, photo))?;
        Ok(Some((camera.width, camera.height, rgb)))
    }
}

/// The frame that a mode shows.
fn frame_of(last: &Rendered, mode: Mode) -> Option<&Frame> {
    match mode.look() {
        Some(look) => last.looks[look as usize].as_deref(),
        None => Some(&last.frame),
    }
}

/// Whether two cameras differ in their number of pixels alone.
fn sees_the_same(a: &Camera, b: &Camera) -> bool {
    let angles = |camera: &Camera| camera.focal / glam::DVec2::new(camera.width.into(), camera.height.into());
    a.has_pose_of(b) && angles(a).abs_diff_eq(angles(b), 1e-9 * angles(b).max_element())
}

/// A texture that frames are put into and the window paints.
pub(crate) fn texture(gpu: &Gpu, [width, height]: [u32; 2]) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("canvas"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    })
}

/// A texture of this size.
fn fitted<'a>(gpu: &Gpu, state: &RenderState, screen: &'a mut Option<Screen>, size: [u32; 2]) -> &'a mut Screen {
    let fits = |screen: &Screen| [screen.texture.width(), screen.texture.height()] == size;
    if !screen.as_ref().is_some_and(fits) {
        let texture = texture(gpu, size);
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let filter = wgpu::FilterMode::Linear;
        let mut painter = state.renderer.write();
        let id = match &screen {
            Some(screen) => {
                painter.update_egui_texture_from_wgpu_texture(&gpu.device, &view, filter, screen.id);
                screen.id
            }
            None => painter.register_native_texture(&gpu.device, &view, filter),
        };
        *screen = Some(Screen { texture, id, shown: None });
    }
    screen.as_mut().expect("just made")
}
