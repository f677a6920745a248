//! The start page, and opening things.

use crate::Wanted;
use crate::app::Viewer;
use eframe::egui::{self, Key, TextEdit, Ui};
use std::path::PathBuf;

/// A field for a path, the demo scene, and what was opened before.
pub fn open(viewer: &mut Viewer, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let field = TextEdit::singleline(&mut viewer.panels.address).hint_text("folder or file").desired_width(260.0);
        let field = ui.add(field).on_hover_text(
            "A model folder, an .ibgs bundle or a PLY file to look at; a scene folder (COLMAP or transforms.json) to train on",
        );
        let entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
        let given = !viewer.panels.address.trim().is_empty();
        let clicked = ui.add_enabled(given, egui::Button::new("Open")).clicked();
        if (entered || clicked) && given {
            let path = PathBuf::from(viewer.panels.address.trim());
            viewer.open(Wanted::Path(path));
            ui.close();
        }
    });
    if ui.button("Train on the demo scene").on_hover_text("A furnished room with a mirror ball, built in").clicked() {
        viewer.open(Wanted::Demo);
        ui.close();
    }
    let recent = viewer.settings.recent.clone();
    if !recent.is_empty() {
        ui.separator();
        ui.weak("Opened before");
        for path in recent {
            if ui.button(path.display().to_string()).clicked() {
                viewer.open(Wanted::Path(path));
                ui.close();
            }
        }
    }
}

/// What the window shows as long as nothing is open.
pub fn start(viewer: &mut Viewer, ui: &mut Ui) {
    if viewer.doing.is_some() {
        return;
    }
    ui.vertical_centered(|ui| {
        ui.add_space(0.15 * ui.available_height());
        ui.heading("ibgs");
        ui.label("Drop a model folder, an .ibgs bundle, a PLY file or a scene folder into this window.");
        ui.add_space(12.0);
        // As wide as the field and its button, so that they stand in the middle.
        let width = 330.0_f32.min(ui.available_width());
        ui.allocate_ui_with_layout(egui::Vec2::new(width, 0.0), egui::Layout::top_down(egui::Align::Min), |ui| {
            open(viewer, ui)
        });
    });
}
