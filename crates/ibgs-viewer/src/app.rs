//! The window: camera, what is open, and what stands around the canvas.

mod framing;
mod input;
mod link;
mod messages;
mod screenshot;

use crate::canvas::{Canvas, SIDES, Wanted as WantedFrame};
use crate::curves::Curves;
use crate::edit::Edit;
use crate::looks::Look;
use crate::mode::Mode;
use crate::navigator::Navigator;
use crate::panels::{self, Panels, Start};
use crate::thumbnails::Thumbnails;
use crate::worker::{Command, Rendered, Worker};
use crate::{Open, Opened, Outcome, Scene, Wanted, marks};
use eframe::egui::{self, Color32, Pos2, Rect, Sense, Ui};
use framing::fitted;
use glam::DVec3;
use ibgs_core::camera::Camera;
use ibgs_core::dataset::HostPhoto;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::inspect::Inspection;
use ibgs_core::output::log::TrainingProgress;
use ibgs_core::sources::DevicePhoto;
use ibgs_core::sources::source_store::pixels;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use web_time::Instant;

/// Time that the camera rests before the picture is rendered sharp.
const REST: Duration = Duration::from_millis(150);
/// What is kept from one start of the program to the next.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Settings {
    /// What was opened last, newest first.
    pub recent: Vec<PathBuf>,
}

/// A pixel that was asked about.
pub(crate) struct Found {
    /// Why it looks as it does.
    pub inspection: Inspection,
    /// The scene's views that are its sources, in the inspection's order.
    pub views: Vec<Option<usize>>,
}

/// A training as the window knows it.
pub(crate) struct Trained {
    pub progress: TrainingProgress,
    pub running: bool,
    pub curves: Curves,
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
    /// Share of the canvas left of the divider.
    pub(crate) divider: f32,
    pub(crate) divider_x: Option<f32>,
    /// The view that the camera stands on.
    pub(crate) on_view: Option<usize>,
    pub(crate) found: Option<Found>,
    /// A found pixel that is not shown yet, and the time of the click.
    coming: Option<Found>,
    clicked: Option<Instant>,
    pub(crate) panels: Panels,
    pub(crate) start: Start,
    pub(crate) edit: Edit,
    pub(crate) thumbnails: Thumbnails,
    pub(crate) settings: Settings,
    photo: Option<(usize, DevicePhoto)>,
    /// What the cameras look at, and extent of the scene.
    center: DVec3,
    pub(crate) extent: f64,
    /// Size of the canvas in pixels.
    room: [u32; 2],
    /// The photos' mean up axis.
    pub(crate) photos_up: DVec3,
    moved: Option<Instant>,
    /// What the worker is doing, when it is no frame.
    pub(crate) doing: Option<String>,
    /// What was done last, in one sentence.
    pub(crate) message: Option<String>,
    /// What went wrong last, in one sentence.
    pub(crate) error: Option<String>,
    screenshots: u32,
    /// Where to go once something is open.
    link: Option<String>,
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
        let settings = cc.storage.and_then(|storage| eframe::get_value(storage, eframe::APP_KEY)).unwrap_or_default();
        let canvas = Canvas::new(gpu.clone())?;
        let mut start = Start::new(opener.demo_iterations(&gpu));
        let opened = match first {
            Some(Outcome::Opened(opened)) => Some(*opened),
            Some(Outcome::Scene(path)) => {
                start.ask_about(path);
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
            divider: 0.5,
            divider_x: None,
            on_view: None,
            found: None,
            coming: None,
            clicked: None,
            panels: Panels::default(),
            start,
            edit: Edit::default(),
            thumbnails: Thumbnails::default(),
            settings,
            photo: None,
            center: DVec3::ZERO,
            extent: 1.0,
            room: SIDES,
            photos_up: DVec3::NEG_Y,
            moved: None,
            doing,
            message: None,
            error: None,
            screenshots: 0,
            link: None,
        })
    }

    /// What the canvas shows.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// What it shows right of the divider.
    pub fn other_mode(&self) -> Option<Mode> {
        self.other
    }

    /// The view that the camera stands on.
    pub fn on_view(&self) -> Option<usize> {
        self.on_view
    }

    /// Where the camera is.
    pub fn navigator(&self) -> &Navigator {
        &self.navigator
    }

    /// What is open.
    pub fn scene(&self) -> Option<&Scene> {
        self.scene.as_ref()
    }

    /// How far the training is, and whether it continues.
    pub fn progress(&self) -> Option<(&TrainingProgress, bool)> {
        self.training.as_ref().map(|trained| (&trained.progress, trained.running))
    }

    /// The pixel that was asked about last.
    pub fn inspection(&self) -> Option<&Inspection> {
        self.found.as_ref().map(|found| &found.inspection)
    }

    /// Keyframes of the camera path.
    pub fn keyframes(&self) -> usize {
        self.panels.path.keyframes()
    }

    /// Width and height of the last frame in pixels.
    pub fn image_size(&self) -> Option<[u32; 2]> {
        self.canvas.last().map(|last| [last.frame.camera().width, last.frame.camera().height])
    }

    /// Where the line between two modes stands, in points from the window's left.
    pub fn divider(&self) -> Option<f32> {
        self.other.and(self.divider_x)
    }

    /// Shows or hides time, size and memory of the image.
    pub fn show_figures(&mut self, shown: bool) {
        self.panels.hides_figures = !shown;
    }

    /// Whether a resting camera's image has the full size, however long it takes.
    pub fn show_always_sharp(&mut self, on: bool) {
        self.panels.always_sharp = on;
    }

    /// Shows or hides the camera path.
    pub fn show_path(&mut self, shown: bool) {
        self.panels.shows_path = shown;
    }

    /// Where the camera path is saved and loaded.
    pub fn set_path_file(&mut self, path: &std::path::Path) {
        self.panels.path.set_file(path);
    }

    /// What was done last, in one sentence.
    pub fn message(&self) -> Option<&str> {
        self.message.as_deref()
    }

    /// What went wrong last, in one sentence.
    pub fn error(&self) -> Option<&str> {
        self.error.as_deref()
    }

    /// Whether the last frame or the start page is up to date and no work is in progress.
    pub fn is_settled(&self) -> bool {
        let has_all = match self.start.shown {
            true => self.start.is_complete(),
            false => self.scene.is_none() || self.canvas.is_settled(),
        };
        self.doing.is_none() && !self.moving() && has_all
    }

    fn shows(&self, wanted: impl Fn(Mode) -> bool) -> bool {
        wanted(self.mode) || self.other.is_some_and(wanted)
    }

    /// Whether the model and the camera's place have what a mode shows.
    pub fn offers(&self, mode: Mode) -> bool {
        let has_photo = || self.view().is_some_and(|view| view.photo.is_some());
        let has_network = || self.canvas.last().is_some_and(|last| last.facts.sources.is_some());
        (!mode.needs_network() || has_network()) && (!mode.needs_photo() || has_photo())
    }

    fn view(&self) -> Option<&crate::View> {
        self.on_view.and_then(|index| self.scene.as_ref()?.views.get(index))
    }

    /// Shows another part of the image, where there is one.
    pub fn show_mode(&mut self, mode: Mode) {
        if self.offers(mode) {
            self.mode = mode;
        }
    }

    /// Shows a mode right of a divider, or one mode alone.
    pub fn show_other(&mut self, mode: Option<Mode>) {
        self.other = mode.filter(|&mode| self.offers(mode));
    }

    fn leave_what_is_not_offered(&mut self) {
        if !self.offers(self.mode) {
            self.mode = Mode::Final;
        }
        self.other = self.other.filter(|&mode| self.offers(mode));
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

    /// Back to the first view.
    pub fn reset(&mut self) {
        match self.scene.as_ref().is_none_or(|scene| scene.views.is_empty()) {
            true => {
                self.navigator = Navigator::facing(self.center, 2.5 * self.extent);
                self.has_moved();
            }
            false => self.stand_on(0),
        }
    }

    /// The camera has left the view that it stood on.
    pub(crate) fn has_moved(&mut self) {
        self.on_view = None;
        self.moved = Some(Instant::now());
        self.leave_what_is_not_offered();
    }

    fn moving(&self) -> bool {
        self.moved.is_some_and(|at| at.elapsed() < REST)
    }

    /// Opens something in place of what is open.
    pub fn open(&mut self, wanted: Wanted) {
        if !self.edit.may_leave() {
            self.error = Some("the edited model is not saved; open the other one again to leave it so".to_owned());
            return;
        }
        (self.error, self.message, self.doing) = (None, None, Some("opening".to_owned()));
        self.send(Command::Open(wanted));
    }

    /// Shows another model of the same scene in place of the one that is open, from the same place.
    pub fn replace(&mut self, opened: Opened) {
        self.send(Command::Replace(Box::new(opened), self.edit.revision + 1));
    }

    /// Asks the worker for something.
    pub(crate) fn send(&mut self, command: Command) {
        if !self.worker.send(command) {
            self.doing = None;
            self.error = Some("the part that renders has stopped; close the window and start again".to_owned());
        }
    }

    /// The camera of the canvas. That of a view keeps its ratio, and its size where the photo is compared with.
    fn camera(&self) -> Camera {
        let [width, height] = self.room;
        let Some(view) = self.view() else { return self.navigator.camera(width, height) };
        if self.shows(Mode::needs_photo) {
            return view.camera;
        }
        let sides = |side: f64| (side.round() as u32).max(SIDES[0]);
        let (w, h) = (f64::from(view.camera.width), f64::from(view.camera.height));
        let scale = (f64::from(width) / w).min(f64::from(height) / h);
        view.camera.resized(sides(w * scale), sides(h * scale))
    }

    fn photo(&mut self) -> Result<Option<DevicePhoto>, GpuError> {
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

    fn central(&mut self, ui: &mut Ui, frame: &eframe::Frame) -> Result<(), GpuError> {
        let room = ui.available_rect_before_wrap();
        let response = ui.allocate_rect(room, Sense::click_and_drag());
        let response = response.on_hover_cursor(egui::CursorIcon::Crosshair);
        let pixels = room.size() * ui.ctx().pixels_per_point();
        self.room = [pixels.x, pixels.y].map(|length| (length.round() as u32).clamp(SIDES[0], SIDES[1]));
        let camera = self.camera();
        self.pointer(ui, &response, fitted(room, camera.width as f32 / camera.height as f32));
        if let Some(pose) = self.panels.path.pose(ui) {
            self.navigator.follow(&pose);
            self.has_moved();
        }
        let camera = self.camera();
        let image = fitted(room, camera.width as f32 / camera.height as f32);
        let wanted = WantedFrame {
            camera,
            moving: self.moving(),
            exact: self.view().is_some() && self.shows(Mode::needs_photo),
            always_sharp: self.panels.always_sharp,
            with_range: self.shows(|mode| mode == Mode::Depth) || self.edit.needs_depths(),
            looks: Look::ALL.map(|look| self.shows(|mode| mode.look() == Some(look))),
            iteration: self.training.as_ref().map_or(self.edit.revision, |trained| trained.progress.iteration),
            running: self.training.as_ref().is_some_and(|trained| trained.running),
        };
        let Some(state) = frame.wgpu_render_state() else { return Ok(()) };
        // A device that has failed once returns nothing.
        if self.gpu.check().is_ok()
            && let Some(request) = self.canvas.request(&wanted)
        {
            let sheet = self.canvas.sheet(state, &request, self.mode);
            self.send(Command::Render(Box::new(request), sheet));
        }
        let painter = ui.painter_at(room);
        painter.rect_filled(room, 0.0, Color32::BLACK);
        let photo = self.photo()?;
        let split = if self.other.is_some() { self.divider } else { 1.0 };
        let sides = [Some((self.mode, 0.0, split)), self.other.map(|other| (other, split, 1.0))];
        for (number, (mode, from, to)) in sides.into_iter().enumerate().filter_map(|(i, side)| Some((i, side?))) {
            if let Some(texture) = self.canvas.texture(state, number, mode, photo.as_ref())? {
                let at = |share: f32| image.left() + share * image.width();
                let part = Rect::from_min_max(Pos2::new(at(from), image.top()), Pos2::new(at(to), image.bottom()));
                let whole = Rect::from_min_max(Pos2::new(from, 0.0), Pos2::new(to, 1.0));
                painter.image(texture, part, whole, Color32::WHITE);
            }
        }
        marks::draw(self, &painter, image, &camera);
        panels::divider(self, ui, image);
        panels::edit_in_image(self, ui, &response, image, &camera);
        panels::overlay(self, ui, room);
        let is_outdated = |last: &Rendered| last.iteration != wanted.iteration || last.facts.is_loading;
        let outdated = self.canvas.last().is_some_and(is_outdated);
        if self.moving() || outdated {
            ui.ctx().request_repaint_after(Duration::from_millis(20));
        }
        Ok(())
    }

    fn dropped(&mut self, ctx: &egui::Context) {
        let first = ctx.input(|input| input.raw.dropped_files.first().map(|file| file.path().to_owned()));
        if let Some(path) = first {
            self.open(Wanted::Path(path));
        }
    }
}

impl eframe::App for Viewer {
    /// How a page reaches its viewer.
    #[cfg(target_arch = "wasm32")]
    fn as_any_mut(&mut self) -> Option<&mut dyn std::any::Any> {
        Some(self)
    }

    fn ui(&mut self, ui: &mut Ui, frame: &mut eframe::Frame) {
        self.listen(ui.ctx());
        self.dropped(ui.ctx());
        panels::chosen(self);
        self.show_found(ui.ctx());
        if !self.start.shown {
            self.keys(ui);
        }
        panels::bar(self, ui);
        if self.start.shown || self.scene.is_none() {
            let shown = self.start.shown;
            egui::CentralPanel::default().show(ui, |ui| shown.then(|| panels::start(self, ui)));
            panels::status(self, ui.ctx());
            return;
        }
        panels::around(self, ui);
        let shown = egui::CentralPanel::no_frame().show(ui, |ui| self.central(ui, frame));
        if let Err(error) = shown.inner {
            // The worker reports what has become of a training.
            self.error.get_or_insert_with(|| error.to_string());
        }
        panels::status(self, ui.ctx());
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        eframe::set_value(storage, eframe::APP_KEY, &self.settings);
    }
}
