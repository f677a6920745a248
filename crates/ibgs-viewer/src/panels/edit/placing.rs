//! Placing the model: its size by a known length, its ground, and numbers.

use super::tools;
use crate::edit::{Edit, Tool};
use crate::settings::Unit;
use crate::viewer::Viewer;
use eframe::egui::{Button, DragValue, Response, Ui};
use glam::{DMat3, DQuat, DVec3, EulerRot};
use ibgs_core::similarity::Similarity;

/// Order in which the model is turned about the axes.
const ORDER: EulerRot = EulerRot::XYZ;

/// Tools, the measured length, and the placement in numbers. With the gizmo the ground of the file stands still in the picture,
/// else the model does.
pub fn placing(viewer: &mut Viewer, ui: &mut Ui) {
    let (extent, unit, edit) = (viewer.extent, viewer.settings.unit, &mut viewer.edit);
    ui.label("What is saved is moved, turned and scaled, with its cameras. The grid is the ground of the file.");
    let tool = tools(edit, &Tool::PLACING, ui);
    if tool == Some(Tool::Length) {
        length(edit, unit, ui);
    }
    if viewer.misses_gizmo() {
        ui.label("The middle of the model, where the gizmo stands, is outside of the picture.");
        if ui.button("Look at it").on_hover_text("Turn the camera to the middle of the model").clicked() {
            viewer.navigator.focus(viewer.center);
            viewer.has_moved();
        }
    }
    numbers(&mut viewer.edit, extent, ui);
}

/// The measured length, and what it is in truth.
fn length(edit: &mut Edit, unit: Unit, ui: &mut Ui) {
    let Some(measured) = edit.length().map(|length| length * unit.per_file_unit()) else { return };
    ui.horizontal_wrapped(|ui| {
        ui.label("measured");
        ui.strong(format!("{measured:.4}{}", unit.sign()));
    });
    ui.horizontal_wrapped(|ui| {
        ui.label("is in truth");
        let least = f64::MIN_POSITIVE;
        let mut length = edit.true_length * unit.per_file_unit();
        let value = DragValue::new(&mut length).range(least..=f64::INFINITY).speed(0.002 * measured).max_decimals(4);
        if ui.add(value.suffix(unit.sign())).changed() {
            edit.true_length = length / unit.per_file_unit();
        }
        if ui.button("Set scale").on_hover_text("Scale the model so that it is").clicked() {
            edit.set_length();
        }
    });
}

/// Place, turn and scale, and the way back.
fn numbers(edit: &mut Edit, extent: f64, ui: &mut Ui) {
    let Some(editor) = &mut edit.editor else { return };
    let Similarity { mut scale, rotation, mut translation } = *editor.placement();
    let (x, y, z) = DQuat::from_mat3(&rotation).to_euler(ORDER);
    // Zero without a sign.
    let mut turn = DVec3::new(x, y, z).map(|angle| angle.to_degrees() + 0.0);
    let speed = 0.005 * extent * scale;
    let mut touched: Vec<Response> = Vec::new();
    let mut row = |ui: &mut Ui, name: &str, values: &mut DVec3, speed: f64, unit: &str| {
        ui.horizontal_wrapped(|ui| {
            ui.label(name);
            for value in values.as_mut() {
                touched.push(ui.add(DragValue::new(value).speed(speed).max_decimals(3).suffix(unit)));
            }
        });
    };
    row(ui, "move", &mut translation, speed, "");
    row(ui, "turn", &mut turn, 0.5, "°");
    ui.horizontal_wrapped(|ui| {
        ui.label("scale");
        let range = f64::MIN_POSITIVE..=f64::INFINITY;
        let speed = 0.005 * scale;
        touched.push(ui.add(DragValue::new(&mut scale).range(range).speed(speed).max_decimals(4)));
    });
    // A drag is one step, and so is a number that was typed.
    let begins = touched.iter().any(Response::drag_started);
    let ends = touched.iter().any(Response::drag_stopped);
    let (changed, dragged) = (touched.iter().any(Response::changed), touched.iter().any(Response::dragged));
    if begins {
        editor.begin();
    }
    if changed {
        let [x, y, z] = turn.map(f64::to_radians).to_array();
        // A move leaves the turn as it is, to the last bit.
        let turned = touched[3..6].iter().any(Response::changed);
        let rotation = if turned { DMat3::from_euler(ORDER, x, y, z) } else { rotation };
        let placement = Similarity { scale, rotation, translation };
        match dragged || ends {
            true => editor.change_placement(placement),
            false => editor.place(placement),
        }
    }
    if ends {
        editor.end();
    }
    let moved = *editor.placement() != Similarity::IDENTITY;
    if ui.add_enabled(moved, Button::new("As it was")).on_hover_text("As the model was opened").clicked() {
        edit.place(Similarity::IDENTITY);
    }
}
