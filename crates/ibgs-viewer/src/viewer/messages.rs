//! Messages from the worker.

use super::framing::{lowest, middle};
use super::{End, Found, Over, Panels, Trained, Viewer};
use crate::Scene;
use crate::edit::Edit;
use crate::mode::Mode;
use crate::preparing::Sign;
use crate::thumbnails::Thumbnails;
use crate::worker::Message;
use eframe::egui::{self, ViewportCommand};
use ibgs_core::camera::{scene_extent, usable_extent};
use ibgs_core::camera_path::turntable::{looked_at, up_axis};
use ibgs_core::inspect::Inspection;
use ibgs_core::output::log::TrainingProgress;
use std::time::Duration;

/// Longest time between the clicks of a double click.
const DOUBLE_CLICK: Duration = Duration::from_millis(320);
/// Recently opened paths that are kept.
const RECENT: usize = 8;

impl Viewer {
    /// Takes the messages of the worker.
    pub(crate) fn listen(&mut self, ctx: &egui::Context) {
        while let Ok(message) = self.worker.messages.try_recv() {
            match message {
                Message::Doing(what) => self.doing = Some(what),
                Message::Opened(scene, progress) => self.opened(*scene, progress, ctx),
                Message::Replaced(scene, revision) => {
                    (self.edit.revision, self.thumbnails) = (revision, Thumbnails::default());
                    self.scene = Some(*scene);
                }
                Message::Scene(path) => {
                    (self.doing, self.opening) = (None, false);
                    self.start.ask_about(path);
                }
                Message::Photos(path) => {
                    (self.doing, self.opening) = (None, false);
                    self.start.ask_about_photos(path);
                }
                Message::Preparing(sign) => self.prepared(sign),
                Message::Shared(outcome) => self.shared(outcome),
                Message::Rendered(rendered) => {
                    self.canvas.take(*rendered);
                    self.leave_what_is_not_offered();
                }
                Message::Inspected { found, focus } => self.inspected(*found, focus),
                Message::Progress(progress, running) => {
                    self.doing = None;
                    if let Some(trained) = &mut self.training {
                        trained.take(*progress, running);
                    }
                }
                Message::Ended { saved } => {
                    if let Some(trained) = &mut self.training {
                        (trained.end, trained.running) = (Some(if saved { End::Saved } else { End::Failed }), false);
                    }
                }
                Message::Saved(path) => self.message = Some(format!("saved: {}", path.display())),
                Message::Filmed(done) => self.panels.path.filming.iter_mut().for_each(|bar| bar.done = done),
                Message::Keyframe(of, rgb) => self.take_keyframe(&of, rgb, ctx),
                Message::FilmDone(written) => self.take_film(written),
                Message::Edit(message) => {
                    let said = self.edit.take(message, self.navigator.up);
                    self.message = said.or(self.message.take());
                    self.doing = None;
                    self.saved_or_not(ctx);
                }
                Message::NoFrame => self.canvas.give_up(),
                Message::NoRoom(sentence) => {
                    if !self.canvas.give_up_size() {
                        self.error = Some(sentence);
                    }
                }
                Message::Failed(sentence) => {
                    (self.doing, self.opening) = (None, false);
                    self.error = Some(sentence);
                    self.saved_or_not(ctx);
                }
            }
        }
    }

    fn opened(&mut self, scene: Scene, progress: Option<TrainingProgress>, ctx: &egui::Context) {
        ctx.send_viewport_cmd(ViewportCommand::Title(format!("{} - ibgs", scene.title)));
        if let Some(path) = scene.path.as_ref().and_then(|path| std::path::absolute(path).ok()) {
            self.settings.recent.retain(|other| *other != path);
            self.settings.recent.insert(0, path);
            self.settings.recent.truncate(RECENT);
        }
        let cameras = || scene.views.iter().map(|view| &view.camera);
        let (mean, extent) = scene_extent(cameras());
        self.extent = usable_extent(extent);
        self.center = looked_at(cameras()).unwrap_or(mean);
        if scene.views.is_empty() && !scene.points.is_empty() {
            (self.center, self.extent) = middle(scene.points.iter().map(|point| point.position));
        }
        self.message = scene.note.clone().or(self.message.take());
        self.photos_up = up_axis(cameras());
        self.navigator.up = self.photos_up;
        self.ground = lowest(scene.points.iter().map(|point| point.position), self.photos_up, self.center);
        let middle = if scene.views.is_empty() { self.center } else { mean };
        self.edit = Edit::of(&scene, middle, self.extent);
        (self.training, self.opening) = (progress.map(Trained::new), false);
        self.start.shown = false;
        (self.scene, self.doing, self.found, self.photo) = (Some(scene), None, None, None);
        (self.mode, self.other, self.on_view, self.moved) = (Mode::Final, None, None, None);
        self.lacks_final = false;
        (self.coming, self.clicked) = (None, None);
        self.thumbnails = Thumbnails::default();
        self.panels = Panels {
            only_frame: self.panels.only_frame,
            over: self.panels.over.filter(|over| *over == Over::Settings),
            ..Panels::default()
        };
        self.canvas.clear();
        self.reset();
        if let Some(link) = self.link.take() {
            self.follow_link(&link);
        }
    }

    /// Takes how a preparation goes. Where something else is looked at when it ends, that stays.
    fn prepared(&mut self, sign: Sign) {
        self.start.preparing.take(&sign);
        match sign {
            Sign::Made(scene) if self.start.shown => self.start.ask_about(scene),
            Sign::Made(scene) => {
                self.message = Some(format!("{} is ready: the start page trains on it", scene.display()));
                self.start.form.set_scene(scene);
            }
            Sign::Failed(sentence) => self.error = Some(sentence),
            _ => {}
        }
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
    pub(crate) fn show_found(&mut self, ctx: &egui::Context) {
        let Some(clicked) = self.clicked.filter(|_| self.coming.is_some()) else { return };
        match DOUBLE_CLICK.checked_sub(clicked.elapsed()) {
            Some(rest) => ctx.request_repaint_after(rest),
            None => {
                self.found = self.coming.take();
                (self.panels.shows_pixel, self.panels.folds_facts) = (true, false);
            }
        }
    }
}
