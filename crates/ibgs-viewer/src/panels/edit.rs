//! The editor: its panel, what it draws over the image, and its keys.

mod gizmo;
mod image;
mod placing;
mod values;

pub use gizmo::grab;
pub use image::{draw, grab_box, in_image};

use crate::edit::{Edit, Tool};
use crate::icons::{self, icon};
use crate::viewer::Viewer;
use eframe::egui::{Button, CollapsingHeader, DragValue, Grid, Slider, TextEdit, Ui};
use glam::DVec3;
use ibgs_core::edit::{Combine, Editor};
use ibgs_core::scene::Format;

/// The panel at the right.
pub fn panel(viewer: &mut Viewer, ui: &mut Ui) {
    if !viewer.edit.shown {
        return;
    }
    ui.heading("Edit the model");
    if viewer.edit.editor.is_none() {
        ui.horizontal(|ui| {
            ui.spinner();
            ui.label("reading the Gaussians");
        });
        ui.separator();
        return;
    }
    counts(&viewer.edit, ui);
    actions(&mut viewer.edit, ui);
    ui.separator();
    selection(viewer, ui);
    CollapsingHeader::new("By values").show(ui, |ui| values::ranges(viewer, ui));
    CollapsingHeader::new("Floaters").show(ui, |ui| values::floaters(&mut viewer.edit, viewer.extent, ui));
    CollapsingHeader::new("Place and size").show(ui, |ui| placing::placing(viewer, ui));
    ui.separator();
    save(viewer, ui);
    ui.separator();
}

fn counts(edit: &Edit, ui: &mut Ui) {
    let Some(editor) = &edit.editor else { return };
    let (left, whole) = (editor.left_count(), editor.gaussians().len());
    // What is usual always has its row, so that the buttons below stay where they are.
    let always = [("Gaussians left", left), ("selected", editor.selected_count()), ("deleted", whole - left)];
    let others = [("hidden", editor.hidden_count()), ("locked", editor.locked_count())];
    Grid::new("counts").num_columns(2).show(ui, |ui| {
        for (name, count) in always.into_iter().chain(others.into_iter().filter(|(_, count)| *count > 0)) {
            ui.label(name);
            ui.strong(count.to_string());
            ui.end_row();
        }
    });
}

/// What can be done with the selection.
fn actions(edit: &mut Edit, ui: &mut Ui) {
    let Some(editor) = &edit.editor else { return };
    let (selects, removes) = (editor.selected_count() > 0, editor.can_remove());
    let (undoes, redoes) = (editor.can_undo(), editor.can_redo());
    let (hides, locks) = (editor.hidden_count() > 0, editor.locked_count() > 0);
    let mut act = |ui: &mut Ui, on: bool, name: &str, text: &str, step: fn(&mut Editor)| {
        if ui.add_enabled(on, Button::new(name)).on_hover_text(text).on_disabled_hover_text(text).clicked() {
            edit.step(step);
        }
    };
    ui.horizontal_wrapped(|ui| {
        let text = "Delete what is selected; at least one Gaussian stays. Key Delete.";
        act(ui, removes, "Delete", text, |editor| _ = editor.delete());
        let text = "Delete all that is not selected; what is hidden or locked stays";
        act(ui, removes, "Keep only", text, |editor| _ = editor.keep());
        act(ui, undoes, "Undo", "Take the last step back. Ctrl+Z.", Editor::undo);
        act(ui, redoes, "Redo", "Take it again. Ctrl+Shift+Z.", Editor::redo);
    });
    ui.horizontal_wrapped(|ui| {
        let text = "Do not show what is selected; it stays in the model. Key H.";
        act(ui, selects, "Hide", text, |editor| _ = editor.hide());
        act(ui, hides, "Show all", "Show what is hidden. Shift+H.", |editor| _ = editor.show_all());
        let text = "No tool selects or deletes what is locked. Key L.";
        act(ui, selects, "Lock", text, |editor| _ = editor.lock());
        act(ui, locks, "Unlock all", "Unlock what is locked. Shift+L.", |editor| _ = editor.unlock_all());
    });
}

/// How to select, and the tools.
fn selection(viewer: &mut Viewer, ui: &mut Ui) {
    let up = viewer.navigator.up;
    let (extent, edit) = (viewer.extent, &mut viewer.edit);
    ui.strong("Select");
    ui.horizontal_wrapped(|ui| {
        let all = [
            (Combine::Replace, "New", "A selection takes the place of the one before"),
            (Combine::Add, "Add", "A selection is added to the one before; Shift does that too"),
            (Combine::Remove, "Subtract", "A selection is taken away from the one before; Ctrl or Alt does that too"),
            (
                Combine::Intersect,
                "Common",
                "What is in the new selection and in the one before; Ctrl and Shift do that too",
            ),
        ];
        for (how, name, text) in all {
            ui.selectable_value(&mut edit.how, how, name).on_hover_text(text);
        }
    });
    ui.horizontal_wrapped(|ui| {
        if ui.button("All").on_hover_text("Ctrl+A").clicked() {
            edit.step(Editor::select_all);
        }
        if ui.button("None").on_hover_text("Escape, once no tool is taken up").clicked() {
            edit.step(Editor::select_none);
        }
        if ui.button("Invert").on_hover_text("Ctrl+I").clicked() {
            edit.step(Editor::invert);
        }
    });
    ui.add_space(4.0);
    if let Some(tool) = tools(edit, &Tool::SELECTING, ui) {
        tool_options(edit, tool, up, extent, ui);
    }
    ui.add_space(4.0);
}

/// A row of tools, and how the one is used that was taken up, which is returned.
fn tools(edit: &mut Edit, all: &[(Tool, &str, &str)], ui: &mut Ui) -> Option<Tool> {
    ui.horizontal_wrapped(|ui| {
        for (tool, name, text) in all {
            let text = format!("{text} Escape puts the tool down.");
            if ui
                .selectable_label(edit.tool == Some(*tool), (icon(icons::of(*tool)), *name))
                .on_hover_text(text)
                .clicked()
            {
                edit.take_up(*tool);
            }
        }
    });
    let (tool, _, text) = all.iter().find(|(tool, ..)| edit.tool == Some(*tool))?;
    ui.label(*text);
    Some(*tool)
}

fn tool_options(edit: &mut Edit, tool: Tool, up: DVec3, extent: f64, ui: &mut Ui) {
    if tool == Tool::Box {
        crop_box(edit, up, extent, ui);
    }
    if tool == Tool::Brush {
        ui.add(Slider::new(&mut edit.radius, 2.0..=200.0).logarithmic(true).fixed_decimals(0).text("radius"));
    }
    if tool.has_front() {
        ui.checkbox(&mut edit.in_front, "Only in front").on_hover_text(
            "Leave out what lies behind the surface: behind the depth where half of the light is stopped",
        );
    }
    if tool == Tool::Flood {
        let gaps = 0.001 * extent..=extent;
        ui.add(Slider::new(&mut edit.gap, gaps).logarithmic(true).text("gap"))
            .on_hover_text("In scene units: what lies farther apart is not connected");
        ui.checkbox(&mut edit.same_color, "Of one colour")
            .on_hover_text("Stay within the tolerance of the first colour");
    }
    if tool == Tool::Color || tool == Tool::Flood && edit.same_color {
        ui.add(Slider::new(&mut edit.tolerance, 0.01..=1.0).logarithmic(true).text("tolerance"))
            .on_hover_text("Largest difference of two colours, each from 0 to 1 in red, green and blue");
    }
}

fn crop_box(edit: &mut Edit, up: DVec3, extent: f64, ui: &mut Ui) {
    let Some(crop) = &mut edit.crop else { return };
    let speed = 0.002 * extent;
    let row = |ui: &mut Ui, name: &str, text: &str, values: &mut DVec3, least: f64| {
        ui.horizontal_wrapped(|ui| {
            ui.label(name).on_hover_text(text);
            for value in values.as_mut() {
                ui.add(DragValue::new(value).speed(speed).range(least..=f64::INFINITY).max_decimals(3));
            }
        });
    };
    row(ui, "centre", "x, y, z in the scene", &mut crop.center, f64::NEG_INFINITY);
    row(ui, "size", "Across, across, along the up axis", &mut crop.size, f64::MIN_POSITIVE);
    ui.horizontal_wrapped(|ui| {
        ui.label("turn").on_hover_text("About the up axis");
        let mut degrees = crop.turn.to_degrees();
        if ui.add(DragValue::new(&mut degrees).speed(0.5).max_decimals(1).suffix("°")).changed() {
            crop.turn = degrees.to_radians();
        }
    });
    crop.up = up;
    ui.horizontal_wrapped(|ui| {
        if ui.button("Inside").on_hover_text("Select what lies in the box").clicked() {
            edit.select_box(true);
        }
        if ui.button("Outside").on_hover_text("Select what lies beside the box").clicked() {
            edit.select_box(false);
        }
        let text = "Put the box around what is selected; where nothing is, around most of the model";
        if ui.button("Fit").on_hover_text(text).clicked() {
            edit.fit_box(up);
        }
        let text = "Delete what lies beside the box; what is hidden or locked stays";
        if ui.button("Crop").on_hover_text(text).clicked() {
            edit.crop();
        }
    });
}

fn save(viewer: &mut Viewer, ui: &mut Ui) {
    let edit = &mut viewer.edit;
    ui.horizontal(|ui| {
        ui.strong("Save");
        if edit.is_unsaved() {
            ui.label("not saved yet");
        }
    });
    file(edit, ui);
    if ui.button("Save model").on_hover_text("Ctrl+S").clicked() {
        viewer.save_edited();
    }
}

/// The file that the model is saved as.
pub fn file(edit: &mut Edit, ui: &mut Ui) {
    let field = TextEdit::singleline(&mut edit.file).desired_width(f32::INFINITY);
    ui.add(field).on_hover_text(format!(
        "A name in `.ibgs` keeps network, cameras and source photos; one in {} the Gaussians alone",
        Format::written_endings()
    ));
    ui.checkbox(&mut edit.replaces, "replace").on_hover_text("Replace a file of this name");
}
