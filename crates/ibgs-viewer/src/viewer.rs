//! The state of the window: camera, what is open, and what stands around the canvas.

mod filming;
mod framing;
mod leaving;
mod link;
mod messages;
mod modes;
mod outside;
mod screenshot;
mod sharing;

pub(crate) use framing::{fitted, inscribed, widened};
pub(crate) use leaving::{Answer, Leaving, Next};

use crate::canvas::{Canvas, SIDES};
use crate::curves::Curves;
use crate::edit::Edit;
use crate::mode::Mode;
use crate::navigator::Navigator;
use crate::path_editor::PathEditor;
use crate::settings::Settings;
use crate::share::Share;
use crate::start_page::Start;
use crate::theme;
use crate::thumbnails::Thumbnails;
use crate::worker::{Command, Worker};
use crate::{Open, OpenRequest, Opened, Outcome, PhotosRequest, Scene};
use eframe::egui::Rect;
use glam::DVec3;
use ibgs_core::dataset::HostPhoto;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::inspect::Inspection;
use ibgs_core::output::log::TrainingProgress;
use ibgs_core::sources::DevicePhoto;
use ibgs_core::sources::source_store::pixels;
use std::sync::Arc;
use std::time::Duration;
use web_time::Instant;

/// Time that the camera rests before the picture is rendered sharp.
const REST: Duration = Duration::from_millis(150);

/// Which panels are shown, and what they hold.
#[derive(Default)]
pub(crate) struct Panels {
    /// The scene's cameras in the image.
    pub shows_cameras: bool,
    /// The sparse points.
    pub shows_points: bool,
    /// Why a pixel looks as it does.
    pub shows_pixel: bool,
    /// The list of views is folded, where the user has said so; and so is the panel of facts.
    pub folds_views: Option<bool>,
    pub folds_facts: bool,
    /// Time, size and memory are hidden.
    pub hides_figures: bool,
    /// On a view, nothing around its photo.
    pub only_frame: bool,
    /// The camera path's panel and its timeline.
    pub shows_path: bool,
    /// A menu was open when the frame began.
    pub had_menu: bool,
    /// Where the picture is, once there is one.
    pub picture: Option<Rect>,
    /// What stands over the picture, one at a time.
    pub over: Option<Over>,
    /// The camera path.
    pub path: PathEditor,
}

impl Panels {
    /// Shows something over the picture in place of what stood there, or closes it.
    pub fn put_over(&mut self, over: Over, shown: bool) {
        match shown {
            true => self.over = Some(over),
            false => _ = self.over.take_if(|shown| *shown == over),
        }
    }
}

/// What stands over the picture.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Over {
    Settings,
    Share,
    /// Keys and pointer explained.
    Help,
}

/// A pixel that was asked about.
pub(crate) struct Found {
    /// Why it looks as it does.
    pub inspection: Inspection,
    /// The scene's views that are its sources, in the inspection's order.
    pub views: Vec<Option<usize>>,
}

/// How a training ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    /// Its results are saved.
    Saved,
    /// By an error.
    Failed,
}

/// A training as the window knows it.
pub(crate) struct Trained {
    pub progress: TrainingProgress,
    pub running: bool,
    /// How it ended; none while it can go on.
    pub end: Option<End>,
    pub curves: Curves,
}

impl Trained {
    /// One that begins.
    pub fn new(progress: TrainingProgress) -> Self {
        Self { progress, running: true, end: None, curves: Curves::default() }
    }

    /// Takes how far it is now.
    pub fn take(&mut self, progress: TrainingProgress, running: bool) {
        self.curves.add(&progress);
        (self.progress, self.running) = (progress, running);
    }
}

/// The viewer.
pub struct Viewer {
    pub(crate) gpu: Arc<Gpu>,
    pub(crate) worker: Worker,
    /// What is open.
    pub(crate) scene: Option<Scene>,
    pub(crate) training: Option<Trained>,
    pub(crate) navigator: Navigator,
    pub(crate) canvas: Canvas,
    /// What the canvas shows, and what right of the divider.
    pub(crate) mode: Mode,
    pub(crate) other: Option<Mode>,
    /// The base is shown because the model has no network, or none yet.
    lacks_final: bool,
    /// Share of the canvas left of the divider.
    pub(crate) divider: f32,
    pub(crate) divider_x: Option<f32>,
    /// The view that the camera stands on.
    pub(crate) on_view: Option<usize>,
    pub(crate) found: Option<Found>,
    /// A found pixel that is not shown yet, and the time of the click.
    coming: Option<Found>,
    pub(crate) clicked: Option<Instant>,
    /// The camera is to turn to what the pointer is over.
    pub(crate) focuses: bool,
    pub(crate) panels: Panels,
    pub(crate) start: Start,
    pub(crate) edit: Edit,
    pub(crate) share: Share,
    pub(crate) thumbnails: Thumbnails,
    pub(crate) settings: Settings,
    photo: Option<(usize, DevicePhoto)>,
    /// What the cameras look at, and extent of the scene.
    pub(crate) center: DVec3,
    pub(crate) extent: f64,
    /// A point of the ground; none where no sparse points show it.
    pub(crate) ground: Option<DVec3>,
    /// Size of the canvas in pixels.
    pub(crate) room: [u32; 2],
    /// The photos' mean up axis.
    pub(crate) photos_up: DVec3,
    moved: Option<Instant>,
    /// Something is being opened.
    pub(crate) opening: bool,
    /// What the worker is doing, when it is no frame.
    pub(crate) doing: Option<String>,
    /// What was done last, in one sentence.
    pub(crate) message: Option<String>,
    /// The message that is shown, and since when.
    pub(crate) said: Option<(String, Instant)>,
    /// What went wrong last, in one sentence.
    pub(crate) error: Option<String>,
    screenshots: u32,
    /// Where to go once something is open.
    link: Option<String>,
    /// The question what becomes of unsaved edits.
    pub(crate) leaving: Option<Leaving>,
    /// The window may close without a question.
    closes: bool,
    /// Called when the user decided to stay.
    kept_open: Option<Box<dyn Fn() + Send>>,
}

impl Viewer {
    /// A viewer of what `first` says, or with an empty start page.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(
        cc: &eframe::CreationContext,
        gpu: Arc<Gpu>,
        opener: impl Open,
        first: Option<Outcome>,
    ) -> Result<Self, GpuError> {
        let kept = cc.storage.and_then(|storage| eframe::get_value(storage, eframe::APP_KEY));
        let settings = kept.map_or_else(Settings::default, Settings::sound);
        let canvas = Canvas::new(gpu.clone())?;
        theme::apply(&cc.egui_ctx);
        let mut start = Start::new(opener.demo_iterations(&gpu));
        let opened = match first {
            Some(Outcome::Opened(opened)) => Some(*opened),
            Some(Outcome::Scene(path)) => {
                start.ask_about(path);
                None
            }
            Some(Outcome::Photos(path)) => {
                start.ask_about_photos(path);
                None
            }
            None => None,
        };
        start.shown = opened.is_none();
        let doing = opened.is_some().then(|| "opening".to_owned());
        Ok(Self {
            worker: Worker::start(gpu.clone(), opener, opened, cc.egui_ctx.clone()),
            gpu,
            scene: None,
            training: None,
            navigator: Navigator::facing(DVec3::ZERO, 3.0),
            canvas,
            mode: Mode::Final,
            other: None,
            lacks_final: false,
            divider: 0.5,
            divider_x: None,
            on_view: None,
            found: None,
            coming: None,
            clicked: None,
            focuses: false,
            panels: Panels::default(),
            start,
            edit: Edit::default(),
            share: Share::default(),
            thumbnails: Thumbnails::default(),
            settings,
            photo: None,
            center: DVec3::ZERO,
            extent: 1.0,
            ground: None,
            room: SIDES,
            photos_up: DVec3::NEG_Y,
            moved: None,
            opening: false,
            doing,
            message: None,
            said: None,
            error: None,
            screenshots: 0,
            link: None,
            leaving: None,
            closes: false,
            kept_open: None,
        })
    }

    pub(crate) fn view(&self) -> Option<&crate::View> {
        self.on_view.and_then(|index| self.scene.as_ref()?.views.get(index))
    }

    /// The photo of the view that the camera stands on, where a mode needs it.
    pub(crate) fn photo(&mut self) -> Result<Option<DevicePhoto>, GpuError> {
        let index = self.on_view.filter(|_| self.shows(Mode::needs_photo));
        let Some(index) = index else {
            self.photo = None;
            return Ok(None);
        };
        if self.photo.as_ref().is_none_or(|(of, _)| *of != index) {
            let photo = self.view().and_then(|view| view.photo.clone());
            let upload = |photo: HostPhoto| DevicePhoto::upload(&self.gpu, &*pixels(&photo)?);
            self.photo = photo.map(upload).transpose()?.map(|target| (index, target));
        }
        Ok(self.photo.as_ref().map(|(_, target)| target.clone()))
    }

    /// Stands on a view of the scene.
    pub fn stand_on(&mut self, index: usize) {
        let Some(view) = self.scene.as_ref().and_then(|scene| scene.views.get(index)) else { return };
        self.navigator = Navigator::at(&view.camera, self.center, self.navigator.up);
        self.on_view = Some(index);
        self.leave_what_is_not_offered();
    }

    /// Moves the camera to the next view, or to the one `step` views further.
    pub fn step_view(&mut self, step: isize) {
        let count = self.scene.as_ref().map_or(0, |scene| scene.views.len()) as isize;
        if count > 0 {
            let from = self.on_view.map_or(if step > 0 { -1 } else { 0 }, |index| index as isize);
            self.stand_on((from + step).rem_euclid(count) as usize);
        }
    }

    /// Back to the first view, where some have no photo to the first one that has.
    pub fn reset(&mut self) {
        match self.scene.as_ref().and_then(Scene::first_view) {
            Some(index) => self.stand_on(index),
            None => {
                let facing = Navigator::facing(self.center, 2.5 * self.extent);
                let fov = self.settings.view_angle().unwrap_or(facing.fov);
                self.navigator = Navigator { fov, ..facing };
                self.has_moved();
            }
        }
    }

    /// The camera has left the view that it stood on.
    pub(crate) fn has_moved(&mut self) {
        if let (Some(_), Some(angle)) = (self.on_view.take(), self.settings.view_angle()) {
            self.navigator.fov = angle;
        }
        self.moved = Some(Instant::now());
        self.leave_what_is_not_offered();
    }

    pub(crate) fn moving(&self) -> bool {
        self.moved.is_some_and(|at| at.elapsed() < REST)
    }

    /// Opens something in place of what is open, after a question where that has unsaved edits.
    pub fn open(&mut self, wanted: OpenRequest) {
        match self.edit.is_unsaved() {
            true => self.ask(Next::Open(wanted)),
            false => self.request(wanted),
        }
    }

    /// Makes a scene of photos; what is open stays.
    pub(crate) fn prepare(&mut self, wanted: PhotosRequest) {
        (self.error, self.message) = (None, None);
        self.start.preparing.begin();
        self.worker.stop_preparing(false);
        self.send(Command::Prepare(Box::new(wanted)));
    }

    /// Stops that; what is done of it is kept.
    pub(crate) fn stop_preparing(&mut self) {
        self.start.preparing.stops = true;
        self.worker.stop_preparing(true);
    }

    fn request(&mut self, wanted: OpenRequest) {
        (self.error, self.message, self.doing) = (None, None, Some("opening".to_owned()));
        self.opening = true;
        self.send(Command::Open(wanted));
    }

    /// Shows another model of the same scene in place of the one that is open, from the same place.
    pub fn replace(&mut self, opened: Opened) {
        self.send(Command::Replace(Box::new(opened), self.edit.revision + 1));
    }

    /// Asks the worker for something.
    pub(crate) fn send(&mut self, command: Command) {
        if !self.worker.send(command) {
            (self.doing, self.opening) = (None, false);
            self.error = Some("the part that renders has stopped; close the window and start again".to_owned());
        }
    }
}
