//! The editor: its panel, what it draws over the image, and its keys.

use crate::edit::{Edit, Tool, places};
use crate::marks::Onto;
use crate::viewer::Viewer;
use crate::worker::Command;
use eframe::egui::{
    self, Button, Color32, CursorIcon, DragValue, Grid, Key, Mesh, Modifiers, Painter, PointerButton, Pos2, Rect,
    Sense, Shape, Slider, Stroke, TextEdit, Ui, Vec2,
};
use glam::{DVec2, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::edit::{Combine, CropBox, Editor, box_edges};
use ibgs_core::scene::Format;

/// Colour of what is selected and of the box.
const SELECTED: Color32 = Color32::from_rgb(255, 120, 20);
const BOX: Color32 = Color32::from_rgb(255, 220, 90);
/// Most selected Gaussians that are marked.
const MOST_MARKS: usize = 30_000;
/// Radius of a handle in points, and of what can be grabbed around it.
const HANDLE: f32 = 5.0;
const GRIP: f32 = 9.0;

/// The panel at the right.
pub fn panel(viewer: &mut Viewer, ui: &mut Ui) {
    if !viewer.edit.shown {
        return;
    }
    ui.heading("Edit");
    let Some(editor) = &viewer.edit.editor else {
        ui.horizontal(|ui| {
            ui.spinner();
            ui.label("reading the Gaussians");
        });
        ui.separator();
        return;
    };
    let (left, selected, whole) = (editor.left_count(), editor.selected_count(), editor.gaussians().len());
    Grid::new("counts").num_columns(2).show(ui, |ui| {
        for (name, count) in [("Gaussians left", left), ("deleted", whole - left), ("selected", selected)] {
            ui.label(name);
            ui.strong(count.to_string());
            ui.end_row();
        }
    });
    let command = actions(&mut viewer.edit, ui);
    ui.separator();
    selection(viewer, ui);
    ui.separator();
    let saved = save(viewer, ui);
    for command in [command, saved].into_iter().flatten() {
        hand(viewer, command);
    }
    ui.separator();
}

/// Hands a command to the worker. What was found in the image before is of another model.
fn hand(viewer: &mut Viewer, command: Command) {
    viewer.found = None;
    viewer.send(command);
}

fn actions(edit: &mut Edit, ui: &mut Ui) -> Option<Command> {
    let editor = edit.editor.as_ref()?;
    let (removes, undoes, redoes) = (editor.can_remove(), editor.can_undo(), editor.can_redo());
    let mut command = None;
    let mut act = |ui: &mut Ui, on: bool, name: &str, text: &str, step: fn(&mut Editor) -> bool| {
        if ui.add_enabled(on, Button::new(name)).on_hover_text(text).on_disabled_hover_text(text).clicked() {
            command = edit.step(step);
        }
    };
    ui.horizontal_wrapped(|ui| {
        let text = "Delete what is selected; at least one Gaussian stays. Key Delete.";
        act(ui, removes, "Delete", text, Editor::delete);
        act(ui, removes, "Keep only", "Delete all that is not selected", Editor::keep);
        act(ui, undoes, "Undo", "Take the last step back. Ctrl+Z.", Editor::undo);
        act(ui, redoes, "Redo", "Take it again. Ctrl+Shift+Z.", Editor::redo);
    });
    command
}

fn selection(viewer: &mut Viewer, ui: &mut Ui) {
    let up = viewer.navigator.up;
    let (extent, edit) = (viewer.extent, &mut viewer.edit);
    ui.strong("Select");
    ui.horizontal_wrapped(|ui| {
        let all = [
            (Combine::Replace, "New", "A selection takes the place of the one before"),
            (Combine::Add, "Add", "A selection is added to the one before"),
            (Combine::Remove, "Subtract", "A selection is taken away from the one before"),
        ];
        for (how, name, text) in all {
            ui.selectable_value(&mut edit.how, how, name).on_hover_text(text);
        }
    });
    ui.horizontal_wrapped(|ui| {
        let Some(editor) = &mut edit.editor else { return };
        if ui.button("All").clicked() {
            editor.select_all();
        }
        if ui.button("None").clicked() {
            editor.select_none();
        }
        if ui.button("Invert").clicked() {
            editor.invert();
        }
    });
    ui.add_space(4.0);
    ui.horizontal_wrapped(|ui| {
        let tools = [
            (Tool::Box, "Box", "A box in the scene, with handles on its faces. Escape leaves it."),
            (Tool::Brush, "Brush", "Paint with the left button. Escape leaves it."),
        ];
        for (tool, name, text) in tools {
            if ui.selectable_label(edit.tool == Some(tool), name).on_hover_text(text).clicked() {
                edit.lift();
                edit.tool = if edit.tool == Some(tool) { None } else { Some(tool) };
            }
        }
    });
    match edit.tool {
        Some(Tool::Box) => crop_box(edit, up, extent, ui),
        Some(Tool::Brush) => {
            ui.add(Slider::new(&mut edit.radius, 2.0..=200.0).logarithmic(true).fixed_decimals(0).text("radius"));
            ui.checkbox(&mut edit.in_front, "Only in front").on_hover_text(
                "Leave out what lies behind the surface: behind the depth where half of the light is stopped",
            );
        }
        None => {}
    }
    ui.add_space(4.0);
    filters(edit, extent, ui);
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
    });
}

fn filters(edit: &mut Edit, extent: f64, ui: &mut Ui) {
    let [opacity, size, distance] = &mut edit.limits;
    let rows = [
        (opacity, "opacity below", 0.005, 0.0..=1.0, "Gaussians that are fainter than this"),
        (size, "size above", 0.002 * extent, 0.0..=f64::INFINITY, "Largest standard deviation in scene units"),
        (
            distance,
            "distance above",
            0.01 * extent,
            0.0..=f64::INFINITY,
            "From the middle of the cameras, in scene units",
        ),
    ];
    Grid::new("filters").num_columns(2).show(ui, |ui| {
        for (limit, name, speed, range, text) in rows {
            ui.checkbox(&mut limit.on, name).on_hover_text(text);
            let value = DragValue::new(&mut limit.value).speed(speed).range(range).max_decimals(3);
            limit.on |= ui.add(value).on_hover_text(text).changed();
            ui.end_row();
        }
    });
    let any = !edit.filter().is_empty();
    let button = ui.add_enabled(any, Button::new("Select by values"));
    if button.on_hover_text("Gaussians that meet all limits that are ticked").clicked() {
        edit.select_filter();
    }
}

fn save(viewer: &mut Viewer, ui: &mut Ui) -> Option<Command> {
    let (scene, edit) = (viewer.scene.as_ref()?, &mut viewer.edit);
    ui.horizontal(|ui| {
        ui.strong("Save");
        if edit.is_unsaved() {
            ui.weak("not saved yet");
        }
    });
    file(edit, ui);
    let command = ui.button("Save model").clicked().then(|| edit.save(scene)).flatten();
    if command.is_some() {
        viewer.doing = Some("saving the model".to_owned());
    }
    command
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

/// The editor's keys; each is taken, so that it does nothing else.
pub fn keys(viewer: &mut Viewer, ctx: &egui::Context) {
    if viewer.scene.is_none() || viewer.training.is_some() {
        return;
    }
    let pressed = |modifiers, key| ctx.input_mut(|input| input.consume_key(modifiers, key));
    if pressed(Modifiers::NONE, Key::X) {
        viewer.edit.shown = !viewer.edit.shown;
        viewer.edit.lift();
    }
    if !viewer.edit.shown {
        return;
    }
    if viewer.edit.tool.is_some() && pressed(Modifiers::NONE, Key::Escape) {
        viewer.edit.lift();
        viewer.edit.tool = None;
    }
    let again = pressed(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    let step = match () {
        () if again => Some(Editor::redo as fn(&mut Editor) -> bool),
        () if pressed(Modifiers::COMMAND, Key::Z) => Some(Editor::undo as fn(&mut Editor) -> bool),
        () if pressed(Modifiers::NONE, Key::Delete) => Some(Editor::delete as fn(&mut Editor) -> bool),
        () => None,
    };
    if let Some(command) = step.and_then(|step| viewer.edit.step(step)) {
        hand(viewer, command);
    }
}

/// What is selected, and the box.
pub fn draw(viewer: &Viewer, painter: &Painter, onto: &Onto) {
    let (true, Some(editor)) = (viewer.edit.shown, &viewer.edit.editor) else { return };
    let mut mesh = Mesh::default();
    let step = editor.selected_count().div_ceil(MOST_MARKS).max(1);
    for place in places(editor.gaussians(), editor.selected(), step) {
        if let Some(at) = onto.point(place).filter(|at| onto.image.contains(*at)) {
            mesh.add_colored_rect(Rect::from_center_size(at, Vec2::splat(2.5)), SELECTED);
        }
    }
    painter.add(Shape::mesh(mesh));
    if let (Some(Tool::Box), Some(crop)) = (viewer.edit.tool, &viewer.edit.crop) {
        let corners = crop.corners();
        for (width, color) in [(3.5, Color32::from_black_alpha(120)), (1.5, BOX)] {
            for ends in box_edges() {
                onto.line(painter, ends.map(|corner| corners[corner]), Stroke::new(width, color));
            }
        }
    }
}

/// What the pointer does in the image: it moves the box, or paints.
pub fn in_image(viewer: &mut Viewer, ui: &mut Ui, response: &egui::Response, image: Rect, camera: &Camera) {
    if let Some(command) = viewer.edit.begin() {
        viewer.send(command);
    }
    let Viewer { edit, canvas, extent, .. } = viewer;
    match edit.tool.filter(|_| edit.shown && edit.editor.is_some()) {
        Some(Tool::Box) => {
            if let Some(crop) = &mut edit.crop {
                handles(crop, ui, &Onto::new(camera, image, *extent));
            }
        }
        Some(Tool::Brush) => {
            let pointer = response.hover_pos().or_else(|| response.interact_pointer_pos());
            let down = response.is_pointer_button_down_on()
                && ui.input(|input| input.pointer.button_down(PointerButton::Primary));
            match pointer.filter(|_| down) {
                Some(at) => {
                    let share = (at - image.min) / image.size();
                    let radius = f64::from(edit.radius / image.height().max(1.0));
                    edit.paint(DVec2::new(share.x.into(), share.y.into()), radius, camera, canvas.last());
                }
                None => edit.lift(),
            }
            if let Some(at) = pointer {
                let painter = ui.painter_at(image);
                for (width, color) in [(3.0, Color32::from_black_alpha(120)), (1.5, SELECTED)] {
                    painter.circle_stroke(at, edit.radius, Stroke::new(width, color));
                }
            }
        }
        None => edit.lift(),
    }
}

/// Handles on the faces of the box, and one in its middle that moves it across the view.
fn handles(crop: &mut CropBox, ui: &mut Ui, onto: &Onto) {
    let painter = ui.painter_at(onto.image);
    for face in 0..6 {
        let (place, out) = crop.face(face);
        let Some(moved) = grab(ui, &painter, onto, place, face) else { continue };
        // The way of the handle on the screen for a short step out of the box.
        let step = 1e-3 * crop.size.max_element();
        let Some((from, to)) = onto.point(place).zip(onto.point(place + out * step)) else { continue };
        let way = (to - from) / step as f32;
        // A face that is seen head on has no way to go.
        if way.length_sq() > 1e-6 {
            crop.move_face(face, f64::from(moved.dot(way) / way.length_sq()));
        }
    }
    if let Some(moved) = grab(ui, &painter, onto, crop.center, 6) {
        let camera = onto.camera;
        let pixels = moved / onto.image.size() * Vec2::new(camera.width as f32, camera.height as f32);
        let depth = camera.to_view(crop.center).z;
        let way = DVec2::new(pixels.x.into(), pixels.y.into()) / camera.focal * depth;
        crop.center += camera.view_from_world.transpose() * way.extend(0.0);
    }
}

/// Draws a handle; how far the pointer drags it.
fn grab(ui: &Ui, painter: &Painter, onto: &Onto, place: DVec3, number: usize) -> Option<Vec2> {
    let at: Pos2 = onto.point(place).filter(|at| onto.image.contains(*at))?;
    let grip = Rect::from_center_size(at, Vec2::splat(2.0 * GRIP));
    let response =
        ui.interact(grip, ui.scope_id().with(("box", number)), Sense::drag()).on_hover_cursor(CursorIcon::Grab);
    let fill = if response.hovered() || response.dragged() { Color32::WHITE } else { BOX };
    painter.circle(at, HANDLE, fill, Stroke::new(1.5, Color32::from_black_alpha(200)));
    response.dragged_by(PointerButton::Primary).then(|| response.drag_delta())
}
