//! The window: input, camera, what is open, and what stands around the canvas.

use crate::canvas::{Canvas, SIDES, Wanted as WantedFrame};
use crate::curves::Curves;
use crate::mode::Mode;
use crate::navigator::{Navigator, up_axis};
use crate::panels::{self, Panels};
use crate::thumbnails::Thumbnails;
use crate::worker::{Command, News, Worker};
use crate::{Open, Opened, Progress, Scene, Wanted, marks};
use eframe::egui::{self, Color32, Key, PointerButton, Pos2, Rect, Sense, Ui, Vec2, ViewportCommand};
use glam::{DVec2, DVec3};
use ibgs_core::camera::{Camera, scene_extent};
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::image_io::write_png;
use ibgs_core::inspect::Inspection;
use ibgs_core::loss::Target;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The picture is made sharp when the camera has rested so long.
const REST: Duration = Duration::from_millis(150);
/// Longest time between the clicks of a double click.
const DOUBLE_CLICK: Duration = Duration::from_millis(320);
/// Radians of a drag over the height of the canvas.
const TURN: f64 = 3.0;
/// Scene extents that the camera flies in a second.
const SPEED: f64 = 0.3;
/// Recently opened paths that are kept.
const RECENT: usize = 8;

const MODE_KEYS: [Key; 8] = [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6, Key::Num7, Key::Num8];

/// Keys that do something once.
const SINGLE_KEYS: [Key; 8] =
    [Key::ArrowLeft, Key::ArrowRight, Key::R, Key::C, Key::P, Key::K, Key::Space, Key::Escape];

/// Keys that fly, with their direction: right, down, forward.
const FLY_KEYS: [(Key, DVec3); 6] = [
    (Key::W, DVec3::Z),
    (Key::S, DVec3::NEG_Z),
    (Key::D, DVec3::X),
    (Key::A, DVec3::NEG_X),
    (Key::E, DVec3::NEG_Y),
    (Key::Q, DVec3::Y),
];

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
    pub progress: Progress,
    pub running: bool,
    pub curves: Curves,
}

/// The viewer.
pub struct Viewer {
    pub(crate) gpu: Arc<Gpu>,
    pub(crate) worker: Worker,
    /// What is open; nothing: the start page is shown.
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
    /// What is found before it is shown, and when it was asked for.
    coming: Option<Found>,
    clicked: Option<Instant>,
    pub(crate) panels: Panels,
    pub(crate) thumbnails: Thumbnails,
    pub(crate) settings: Settings,
    photo: Option<(usize, Target)>,
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
}

impl Viewer {
    /// A viewer of what is open already, or with a start page.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(
        cc: &eframe::CreationContext,
        gpu: Arc<Gpu>,
        opener: impl Open,
        opened: Option<Opened>,
    ) -> Result<Self, GpuError> {
        let settings = cc.storage.and_then(|storage| eframe::get_value(storage, eframe::APP_KEY)).unwrap_or_default();
        let canvas = Canvas::new(gpu.clone())?;
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

    /// How far the training is, and whether it goes on.
    pub fn progress(&self) -> Option<(&Progress, bool)> {
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

    /// Whether the last frame is what is wanted, and nothing is being done.
    pub fn is_settled(&self) -> bool {
        self.doing.is_none() && !self.moving() && (self.scene.is_none() || self.canvas.is_settled())
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

    /// Stands on the next view, or the one `step` further.
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
        (self.error, self.message, self.doing) = (None, None, Some("opening".to_owned()));
        self.send(Command::Open(wanted));
    }

    /// Asks the worker for something.
    pub(crate) fn send(&mut self, command: Command) {
        if !self.worker.send(command) {
            self.doing = None;
            self.error = Some("the part that renders has stopped; close the window and start again".to_owned());
        }
    }

    /// Writes what the canvas shows as a picture.
    pub fn screenshot(&mut self) {
        match self.write_screenshot() {
            Ok(Some(path)) => self.message = Some(format!("screenshot: {}", path.display())),
            Ok(None) => {}
            Err(error) => self.error = Some(crate::worker::sentence(&error)),
        }
    }

    fn write_screenshot(&mut self) -> anyhow::Result<Option<PathBuf>> {
        let photo = self.photo()?;
        let Some((width, height, mut rgb)) = self.canvas.picture(self.mode, photo.as_ref())? else { return Ok(None) };
        if let Some(other) = self.other
            && let Some((_, _, right)) = self.canvas.picture(other, photo.as_ref())?
        {
            let from = (self.divider * width as f32).round() as usize;
            let rows = rgb.chunks_exact_mut(3 * width as usize).zip(right.chunks_exact(3 * width as usize));
            rows.for_each(|(left, right)| left[3 * from..].copy_from_slice(&right[3 * from..]));
        }
        let folder = self.scene.as_ref().map(|scene| scene.pictures.join("screenshots")).unwrap_or_default();
        let path = loop {
            self.screenshots += 1;
            let path = folder.join(format!("{:04}.png", self.screenshots));
            if !path.exists() {
                break path;
            }
        };
        write_png(&path, width, height, &rgb)?;
        Ok(Some(path))
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

    fn photo(&mut self) -> Result<Option<Target>, GpuError> {
        let index = self.on_view.filter(|_| self.shows(Mode::needs_photo));
        let Some(index) = index else {
            self.photo = None;
            return Ok(None);
        };
        if self.photo.as_ref().is_none_or(|(of, _)| *of != index) {
            let photo = self.view().and_then(|view| view.photo.clone());
            let upload = |photo: Arc<ibgs_core::dataset::Photo>| Target::upload(&self.gpu, &photo);
            self.photo = photo.map(upload).transpose()?.map(|target| (index, target));
        }
        Ok(self.photo.as_ref().map(|(_, target)| target.clone()))
    }

    /// Takes what the worker has to tell.
    fn listen(&mut self, ctx: &egui::Context) {
        while let Ok(news) = self.worker.news.try_recv() {
            match news {
                News::Doing(what) => self.doing = Some(what),
                News::Opened(scene, progress) => self.opened(*scene, progress, ctx),
                News::Rendered(rendered) => {
                    self.canvas.take(*rendered);
                    self.leave_what_is_not_offered();
                }
                News::Inspected { found, focus } => self.inspected(*found, focus),
                News::Progress(progress, running) => {
                    self.doing = None;
                    if let Some(trained) = &mut self.training {
                        trained.curves.add(&progress);
                        (trained.progress, trained.running) = (*progress, running);
                    }
                }
                News::Saved(path) => self.message = Some(format!("saved: {}", path.display())),
                News::Filmed(done, count) => self.panels.path.filming = Some((done, count)),
                News::FilmDone(written) => {
                    self.panels.path.filming = None;
                    if !written.is_empty() {
                        self.message = Some(written);
                    }
                }
                News::NoFrame => self.canvas.give_up(),
                News::Failed(sentence) => {
                    self.doing = None;
                    self.error = Some(sentence);
                }
            }
        }
    }

    fn opened(&mut self, scene: Scene, progress: Option<Progress>, ctx: &egui::Context) {
        ctx.send_viewport_cmd(ViewportCommand::Title(format!("{} - ibgs", scene.title)));
        if let Some(path) = scene.path.as_ref().and_then(|path| std::path::absolute(path).ok()) {
            self.settings.recent.retain(|other| *other != path);
            self.settings.recent.insert(0, path);
            self.settings.recent.truncate(RECENT);
        }
        let cameras = || scene.views.iter().map(|view| &view.camera);
        let (mean, extent) = scene_extent(cameras());
        self.extent = if extent > 1e-6 { extent } else { 1.0 };
        self.center = looked_at(cameras()).unwrap_or(mean);
        if scene.views.is_empty() && !scene.points.is_empty() {
            (self.center, self.extent) = middle(scene.points.iter().map(|point| point.position));
        }
        self.photos_up = up_axis(cameras());
        self.navigator.up = self.photos_up;
        self.training = progress.map(|progress| Trained { progress, running: true, curves: Curves::default() });
        (self.scene, self.doing, self.found, self.photo) = (Some(scene), None, None, None);
        (self.mode, self.other, self.on_view, self.moved) = (Mode::Final, None, None, None);
        (self.coming, self.clicked) = (None, None);
        self.thumbnails = Thumbnails::default();
        self.panels = Panels { always_sharp: self.panels.always_sharp, ..Panels::default() };
        self.canvas.clear();
        self.reset();
    }

    fn inspected(&mut self, inspection: Inspection, focus: bool) {
        if focus {
            (self.coming, self.clicked) = (None, None);
            if let Some(point) = inspection.point {
                self.navigator.focus(point);
                self.has_moved();
            }
            return;
        }
        let sources = self.canvas.last().and_then(|last| last.facts.sources.clone());
        let view_of = |index: usize| {
            let camera = sources.as_ref()?.get(index)?;
            self.scene.as_ref()?.views.iter().position(|view| view.camera == *camera)
        };
        let views = inspection.sources.iter().map(|source| view_of(source.view)).collect();
        self.coming = Some(Found { inspection, views });
    }

    /// Shows the pixel that was clicked once it is certain that no second click follows: its panels move the canvas.
    fn show_found(&mut self, ctx: &egui::Context) {
        let Some(clicked) = self.clicked.filter(|_| self.coming.is_some()) else { return };
        match DOUBLE_CLICK.checked_sub(clicked.elapsed()) {
            Some(rest) => ctx.request_repaint_after(rest),
            None => {
                self.found = self.coming.take();
                self.panels.shows_pixel = true;
            }
        }
    }

    fn keys(&mut self, ui: &Ui) {
        if ui.ctx().egui_wants_keyboard_input() || self.scene.is_none() {
            return;
        }
        // A widget that was reached by Tab takes these itself.
        let focused = ui.memory(|memory| memory.focused().is_some());
        let (pressed, down, shift, dt) = ui.input(|input| {
            let taken = |key| focused && matches!(key, Key::Space | Key::ArrowLeft | Key::ArrowRight);
            let keys = MODE_KEYS.into_iter().chain(SINGLE_KEYS).filter(|&key| !taken(key));
            let command = input.modifiers.command || input.modifiers.ctrl || input.modifiers.alt;
            let pressed: Vec<Key> = keys.filter(|&key| !command && input.key_pressed(key)).collect();
            let fly = FLY_KEYS.iter().filter(|(key, _)| !command && input.key_down(*key));
            let down: DVec3 = fly.map(|(_, direction)| *direction).sum();
            (pressed, down, input.modifiers.shift, f64::from(input.stable_dt.min(0.1)))
        });
        for key in pressed {
            match key {
                Key::ArrowLeft => self.step_view(-1),
                Key::ArrowRight => self.step_view(1),
                Key::R => self.reset(),
                Key::C => self.panels.shows_cameras = !self.panels.shows_cameras,
                Key::P => self.screenshot(),
                Key::K => self.panels.path.add(&self.navigator),
                Key::Space => self.panels.path.toggle(),
                Key::Escape => (self.found, self.other) = (None, None),
                _ => {
                    let at = MODE_KEYS.iter().position(|&other| other == key).unwrap_or_default();
                    self.show_mode(Mode::ALL[at]);
                }
            }
        }
        if down != DVec3::ZERO {
            let speed = SPEED * self.extent * if shift { 4.0 } else { 1.0 };
            self.navigator.fly(down * speed * dt);
            self.has_moved();
        }
    }

    fn pointer(&mut self, ui: &Ui, response: &egui::Response, image: Rect) {
        let delta = response.drag_delta() / image.height().max(1.0);
        let (x, y) = (f64::from(delta.x), f64::from(delta.y));
        if delta != Vec2::ZERO {
            // Dragging moves what is seen along with the pointer; right of it lies what a turn about up brings to the left.
            if response.dragged_by(PointerButton::Primary) {
                self.navigator.orbit(TURN * x, TURN * y);
            } else if response.dragged_by(PointerButton::Secondary) {
                self.navigator.look(TURN * x * 0.5, TURN * y * 0.5);
            } else if response.dragged_by(PointerButton::Middle) {
                self.navigator.pan(DVec2::new(x, y));
            }
            self.has_moved();
        }
        let scroll = ui.input(|input| input.smooth_scroll_delta.y);
        if response.hovered() && scroll != 0.0 {
            self.navigator.zoom(f64::from(scroll) / 50.0);
            self.has_moved();
        }
        let pressed_f = || response.hovered() && ui.input(|input| input.key_pressed(Key::F));
        let focus = response.double_clicked() || pressed_f();
        if focus || response.clicked() {
            let at = response.interact_pointer_pos().or_else(|| ui.input(|input| input.pointer.latest_pos()));
            self.inspect(at.map(|at| (at - image.min) / image.size()), focus);
        }
    }

    /// Asks about a place of the canvas, 0 to 1 in both directions.
    fn inspect(&mut self, place: Option<Vec2>, focus: bool) {
        let inside = |place: &Vec2| (0.0..1.0).contains(&place.x) && (0.0..1.0).contains(&place.y);
        let (Some(place), Some(last)) = (place.filter(inside), self.canvas.last()) else { return };
        let camera = last.frame.camera();
        let pixel = [(place.x * camera.width as f32) as u32, (place.y * camera.height as f32) as u32];
        let frame = last.frame.clone();
        self.clicked = (!focus).then(Instant::now);
        self.send(Command::Inspect { frame, pixel, focus });
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
            (self.navigator.position, self.navigator.world_from_view, self.navigator.fov) = pose;
            self.has_moved();
        }
        let camera = self.camera();
        let image = fitted(room, camera.width as f32 / camera.height as f32);
        let wanted = WantedFrame {
            camera,
            moving: self.moving(),
            exact: self.view().is_some() && self.shows(Mode::needs_photo),
            always_sharp: self.panels.always_sharp,
            with_range: self.shows(|mode| mode == Mode::Depth),
            iteration: self.training.as_ref().map_or(0, |trained| trained.progress.iteration),
            running: self.training.as_ref().is_some_and(|trained| trained.running),
        };
        // A device that has failed once gives nothing any more.
        if self.gpu.check().is_ok()
            && let Some(request) = self.canvas.request(&wanted)
        {
            self.send(Command::Render(request));
        }
        let Some(state) = frame.wgpu_render_state() else { return Ok(()) };
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
        panels::overlay(self, ui, room);
        let outdated = self.canvas.last().is_some_and(|last| last.iteration != wanted.iteration);
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

/// The largest part of a room with this ratio of width and height, in its middle.
fn fitted(room: Rect, ratio: f32) -> Rect {
    let size = match room.width() / room.height().max(1.0) > ratio {
        true => Vec2::new(room.height() * ratio, room.height()),
        false => Vec2::new(room.width(), room.width() / ratio),
    };
    Rect::from_center_size(room.center(), size)
}

/// Median place of some points, and their median distance from it.
fn middle(points: impl Iterator<Item = DVec3> + Clone) -> (DVec3, f64) {
    let median = |values: &mut dyn Iterator<Item = f64>| {
        let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    };
    let axis = |of: fn(DVec3) -> f64| median(&mut points.clone().map(of));
    let center = DVec3::new(axis(|p| p.x), axis(|p| p.y), axis(|p| p.z));
    let extent = median(&mut points.map(|point| point.distance(center)));
    (center, if extent > 1e-6 { extent } else { 1.0 })
}

/// The point nearest to all optical axes: what a capture looks at.
fn looked_at<'a>(cameras: impl Iterator<Item = &'a Camera> + Clone) -> Option<DVec3> {
    // Sum of (I - f f^T) (p - c) = 0 over the cameras.
    let mut matrix = glam::DMat3::ZERO;
    let mut right = DVec3::ZERO;
    for camera in cameras.clone() {
        let f = camera.forward();
        let across = glam::DMat3::IDENTITY - glam::DMat3::from_cols(f * f.x, f * f.y, f * f.z);
        matrix += across;
        right += across * camera.center();
    }
    let count = cameras.clone().count() as f64;
    // Nearly parallel axes meet nowhere.
    if count < 2.0 || matrix.determinant() < 1e-3 * count.powi(3) {
        return None;
    }
    let point = matrix.inverse() * right;
    let ahead = cameras.filter(|camera| camera.to_view(point).z > 0.0).count() as f64;
    (point.is_finite() && ahead > 0.5 * count).then_some(point)
}

impl eframe::App for Viewer {
    fn ui(&mut self, ui: &mut Ui, frame: &mut eframe::Frame) {
        self.listen(ui.ctx());
        self.dropped(ui.ctx());
        self.show_found(ui.ctx());
        self.keys(ui);
        panels::bar(self, ui);
        if self.scene.is_none() {
            egui::CentralPanel::default().show(ui, |ui| panels::start(self, ui));
            panels::status(self, ui.ctx());
            return;
        }
        panels::around(self, ui);
        let shown = egui::CentralPanel::no_frame().show(ui, |ui| self.central(ui, frame));
        if let Err(error) = shown.inner {
            // The worker tells more of what has become of a training.
            self.error.get_or_insert_with(|| error.to_string());
        }
        panels::status(self, ui.ctx());
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        eframe::set_value(storage, eframe::APP_KEY, &self.settings);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_of_cameras_looks_at_its_middle() {
        let target = DVec3::new(1.0, -2.0, 0.5);
        let ring: Vec<Camera> = (0..8)
            .map(|i| {
                let mut navigator = Navigator::facing(target, 3.0);
                navigator.orbit(f64::from(i) * 0.7, 0.3);
                navigator.camera(64, 48)
            })
            .collect();
        assert!(looked_at(ring.iter()).unwrap().abs_diff_eq(target, 1e-9));
        // Cameras that face forward side by side meet nowhere; neither does one alone.
        let row: Vec<Camera> =
            (0..4).map(|i| Navigator::facing(DVec3::new(f64::from(i), 0.0, 0.0), 3.0).camera(64, 48)).collect();
        assert_eq!(looked_at(row.iter()), None);
        assert_eq!(looked_at(ring[..1].iter()), None);
    }

    #[test]
    fn images_fit_into_any_room() {
        let room = Rect::from_min_size(Pos2::new(10.0, 20.0), Vec2::new(200.0, 100.0));
        for ratio in [0.1, 1.0, 2.0, 5.0] {
            let image = fitted(room, ratio);
            assert!(room.expand(0.01).contains_rect(image) && image.center() == room.center());
            assert!((image.width() / image.height() - ratio).abs() < 1e-3);
            assert!((image.width() - 200.0).abs() < 1e-3 || (image.height() - 100.0).abs() < 1e-3);
        }
    }
}
