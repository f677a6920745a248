//! The window as eframe draws it: what stands around the canvas, and the canvas.

mod central;
mod input;

use crate::OpenRequest;
use crate::keys;
use crate::panels;
use crate::viewer::Viewer;
use eframe::egui::{self, Popup, Ui};

impl Viewer {
    fn dropped(&mut self, ctx: &egui::Context) {
        let first = ctx.input(|input| input.raw.dropped_files.first().map(|file| file.path().to_owned()));
        if let Some(path) = first {
            self.open(OpenRequest::Path(path));
        }
    }
}

impl eframe::App for Viewer {
    /// How a page reaches its viewer.
    #[cfg(target_arch = "wasm32")]
    fn as_any_mut(&mut self) -> Option<&mut dyn std::any::Any> {
        Some(self)
    }

    fn logic(&mut self, ctx: &egui::Context, _frame: &mut eframe::Frame) {
        self.guard(ctx);
    }

    fn ui(&mut self, ui: &mut Ui, frame: &mut eframe::Frame) {
        self.panels.had_menu = Popup::is_any_open(ui.ctx());
        self.listen(ui.ctx());
        self.dropped(ui.ctx());
        panels::chosen(self);
        self.show_found(ui.ctx());
        keys::keys(self, ui.ctx());
        self.fly(ui);
        panels::bar(self, ui);
        panels::settings(self, ui.ctx());
        if self.start.shown || self.scene.is_none() {
            self.panels.picture = None;
            let shown = self.start.shown;
            egui::CentralPanel::default().show(ui, |ui| shown.then(|| panels::start(self, ui)));
            panels::status(self, ui.ctx());
            panels::leaving(self, ui.ctx());
            return;
        }
        panels::around(self, ui);
        let shown = egui::CentralPanel::no_frame().show(ui, |ui| self.central(ui, frame));
        if let Err(error) = shown.inner {
            // The worker reports what has become of a training.
            self.error.get_or_insert_with(|| error.to_string());
        }
        panels::status(self, ui.ctx());
        panels::leaving(self, ui.ctx());
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        eframe::set_value(storage, eframe::APP_KEY, &self.settings);
    }
}
