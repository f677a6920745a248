//! The start page, and opening things.

use super::train_form::{PathField, TrainForm};
use crate::app::Viewer;
use crate::{UsualIterations, Wanted};
use eframe::egui::{self, Key, TextEdit, Ui};
use std::path::PathBuf;

/// What the start page holds.
pub struct Start {
    /// It is what the window shows.
    pub shown: bool,
    /// A path that is being typed.
    address: PathField,
    form: TrainForm,
    /// The form is brought into sight.
    finds_form: bool,
}

impl Start {
    /// An empty page.
    pub fn new(usual: UsualIterations) -> Self {
        Self { shown: true, address: PathField::default(), form: TrainForm::new(usual), finds_form: false }
    }

    /// Shows the page with a form for a training on this scene.
    pub fn ask_about(&mut self, scene: PathBuf) {
        self.form.set_scene(scene);
        (self.shown, self.finds_form) = (true, true);
    }
}

/// The menu of the same.
pub fn menu(viewer: &mut Viewer, ui: &mut Ui) {
    if ui.add_enabled(!viewer.start.shown, egui::Button::new("Start page")).clicked() {
        viewer.start.shown = true;
        ui.close();
    }
    recent(viewer, ui);
}

fn recent(viewer: &mut Viewer, ui: &mut Ui) {
    let recent = viewer.settings.recent.clone();
    if recent.is_empty() {
        return;
    }
    ui.separator();
    ui.weak("Opened before");
    for path in recent {
        if ui.button(path.display().to_string()).clicked() {
            viewer.open(Wanted::Path(path));
            ui.close();
        }
    }
}

/// A field for a path.
fn address(viewer: &mut Viewer, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let label = ui.label("Path").id;
        let address = &mut viewer.start.address;
        let width = (ui.available_width() - 60.0).clamp(60.0, 260.0);
        let field = TextEdit::singleline(&mut address.text).hint_text("folder or file").desired_width(width);
        let field = ui.add(field).labelled_by(label).on_hover_text(
            "A model folder, an .ibgs bundle or a PLY file to look at; a scene folder (COLMAP or transforms.json) to train on",
        );
        let entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
        let path = address.path();
        let clicked = ui.add_enabled(path.is_some(), egui::Button::new("Open")).clicked();
        if let Some(path) = path.filter(|_| entered || clicked) {
            viewer.open(Wanted::Path(path));
        }
    });
}

/// The page.
pub fn start(viewer: &mut Viewer, ui: &mut Ui) {
    if viewer.doing.is_some() {
        ui.disable();
    }
    egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        ui.set_max_width(ui.available_width().min(560.0));
        ui.heading("ibgs");
        ui.label("Drop a model folder, an .ibgs bundle, a PLY file or a scene folder into this window.");
        address(viewer, ui);
        if viewer.scene.is_some() && ui.button("Back").on_hover_text("Back to what is open").clicked() {
            viewer.start.shown = false;
        }
        recent(viewer, ui);
        ui.add_space(12.0);
        let form = ui.group(|ui| {
            ui.heading("Train on a scene");
            viewer.start.form.show(ui)
        });
        if std::mem::take(&mut viewer.start.finds_form) {
            form.response.scroll_to_me(None);
        }
        if let Some(wanted) = form.inner {
            viewer.open(wanted);
        }
    });
}
