//! What the editor draws over the image, and what the pointer does there.

use super::gizmo;
use crate::edit::{Edit, Picture, Tool, is_of_tool, places};
use crate::marks::{self, Onto};
use crate::viewer::Viewer;
use eframe::egui::{
    Color32, CursorIcon, InputState, Mesh, Painter, PointerButton, Pos2, Rect, Response, Sense, Shape, Stroke,
    StrokeKind, Ui, Vec2,
};
use glam::{DVec2, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::edit::{Combine, CropBox, Editor, box_edges};

/// Colour of what is selected and of the box.
const SELECTED: Color32 = Color32::from_rgb(255, 120, 20);
pub const BOX: Color32 = Color32::from_rgb(255, 220, 90);
pub const AXES: [Color32; 3] =
    [Color32::from_rgb(235, 70, 70), Color32::from_rgb(90, 200, 90), Color32::from_rgb(90, 140, 255)];
/// Most selected Gaussians that are marked.
const MOST_MARKS: usize = 30_000;
/// Radius of a handle in points, and of what can be grabbed around it.
pub const HANDLE: f32 = 5.0;
const GRIP: f32 = 9.0;
/// Handles of the box.
const HANDLES: usize = 7;

/// What is selected, where the picture does not show it by itself, and the box.
pub fn draw(viewer: &Viewer, painter: &Painter, onto: &Onto) {
    let (true, Some(editor)) = (viewer.edit.shown, &viewer.edit.editor) else { return };
    let revision = viewer.canvas.last().map(|last| last.iteration);
    let is_tinted = revision.is_some_and(|revision| viewer.edit.is_tinted(revision));
    if !is_tinted || !viewer.mode.has_colors() {
        let mut mesh = Mesh::default();
        let step = editor.selected_count().div_ceil(MOST_MARKS).max(1);
        for place in places(editor.gaussians(), editor.selected(), step) {
            if let Some(at) = onto.point(place).filter(|at| onto.image.contains(*at)) {
                mesh.add_colored_rect(Rect::from_center_size(at, Vec2::splat(2.5)), SELECTED);
            }
        }
        painter.add(Shape::mesh(mesh));
    }
    if viewer.edit.shows_ground() {
        draw_placing(&viewer.edit, editor, painter, onto, viewer.extent);
    }
    gizmo::draw(viewer, painter, onto);
    if let (Some(Tool::Box), Some(crop)) = (viewer.edit.tool, &viewer.edit.crop) {
        let corners = crop.corners();
        for stroke in outlined(BOX) {
            for ends in box_edges() {
                onto.line(painter, ends.map(|corner| corners[corner]), stroke);
            }
        }
    }
}

/// The ground of the file and its axes: x red, y green, z blue; and the points that were clicked.
fn draw_placing(edit: &Edit, editor: &Editor, painter: &Painter, onto: &Onto, extent: f64) {
    let scene = editor.placement().inverse();
    let unit = marks::grid_unit(extent * editor.placement().scale);
    let middle = editor.placement().point(edit.middle);
    let at = |x: f64, z: f64| scene.point(DVec3::new(x, 0.0, z));
    let corner = (DVec2::new(middle.x, middle.z) / unit).round() * unit;
    marks::grid(painter, onto, unit, |x, z| at(corner.x + x, corner.y + z));
    for (axis, color) in DVec3::AXES.into_iter().zip(AXES) {
        for stroke in outlined(color) {
            onto.line(painter, [DVec3::ZERO, axis * unit].map(|end| scene.point(end)), stroke);
        }
    }
    for ends in edit.points.windows(2) {
        for stroke in outlined(BOX) {
            onto.line(painter, [ends[0], ends[1]], stroke);
        }
    }
    for at in edit.points.iter().filter_map(|&point| onto.point(point)) {
        painter.circle(at, 0.8 * HANDLE, BOX, Stroke::new(1.5, Color32::from_black_alpha(200)));
    }
}

/// A line that is seen on any colour: its rim, then itself.
pub fn outlined(color: Color32) -> [Stroke; 2] {
    [Stroke::new(3.5, Color32::from_black_alpha(120)), Stroke::new(1.5, color)]
}

/// What the pointer does in the image: it moves the box, or selects.
pub fn in_image(viewer: &mut Viewer, ui: &mut Ui, response: &Response, image: Rect, camera: &Camera) {
    let edits = viewer.edit.shown && viewer.edit.editor.is_some();
    if edits
        && viewer.edit.tool == Some(Tool::Box)
        && let Some(crop) = &mut viewer.edit.crop
    {
        handles(crop, ui, &Onto::new(camera, image, viewer.extent));
    }
    gizmo::drag(viewer, ui, response, image, camera);
    match viewer.edit.pointer() {
        Some(tool) => selects(viewer, tool, ui, response, image, camera),
        None if viewer.edit.held().is_none() => viewer.edit.lift(),
        None => {}
    }
    if let Some(command) = viewer.edit.command() {
        // What was found in the image before is of another model.
        viewer.found = None;
        viewer.send(command);
    }
}

/// The tool's pointer.
fn selects(viewer: &mut Viewer, tool: Tool, ui: &Ui, response: &Response, image: Rect, camera: &Camera) {
    let Viewer { edit, canvas, error, .. } = viewer;
    let radius = f64::from(edit.radius / image.height().max(1.0));
    let picture = Picture { camera, last: canvas.last(), radius };
    let pointer = response.hover_pos().or_else(|| response.interact_pointer_pos());
    let share = |at: Pos2| {
        let share = (at - image.min) / image.size();
        DVec2::new(share.x.into(), share.y.into())
    };
    // A click may begin and end within a frame, and a quick drag has moved on since it began. What `response` asks of the window
    // waits for ever within `input`.
    let clicked = edit.stroke().is_empty() && response.clicked();
    let (how, down, origin) = ui.input(|input| {
        let down = input.pointer.button_down(PointerButton::Primary) && response.is_pointer_button_down_on();
        (how(input, edit.how), down || clicked, input.pointer.press_origin())
    });
    let mut done = Ok(());
    if let Some(at) = pointer.filter(|_| down) {
        if let Some(origin) = origin.filter(|_| edit.stroke().is_empty()) {
            error.take_if(|error| is_of_tool(error));
            done = edit.press(share(origin), how, &picture);
        }
        done = done.and_then(|()| edit.press(share(at), how, &picture));
    }
    if !response.is_pointer_button_down_on() {
        done = done.and(edit.release(&picture));
    }
    if std::mem::take(&mut edit.ends_polygon) && edit.can_close_polygon() {
        done = done.and_then(|()| edit.close_polygon(how, &picture));
    }
    *error = done.err().map(str::to_owned).or(error.take());
    shape(edit, tool, &ui.painter_at(image), pointer);
}

/// How a selection counts: by the keys that are held, else as the panel says.
fn how(input: &InputState, usual: Combine) -> Combine {
    let removes = input.modifiers.ctrl || input.modifiers.command || input.modifiers.alt;
    match (input.modifiers.shift, removes) {
        (true, true) => Combine::Intersect,
        (true, false) => Combine::Add,
        (false, true) => Combine::Remove,
        (false, false) => usual,
    }
}

/// What the tool has drawn so far.
fn shape(edit: &Edit, tool: Tool, painter: &Painter, pointer: Option<Pos2>) {
    let image = painter.clip_rect();
    let place = |share: &DVec2| image.min + Vec2::new(share.x as f32, share.y as f32) * image.size();
    let stroke = edit.stroke();
    let ends = stroke.first().zip(stroke.last()).map(|(first, last)| (place(first), place(last)));
    for line in outlined(SELECTED) {
        match (tool, ends, pointer) {
            (Tool::Brush, _, Some(at)) => _ = painter.circle_stroke(at, edit.radius, line),
            (Tool::Rectangle, Some((from, to)), _) => {
                painter.rect_stroke(Rect::from_two_pos(from, to), 0.0, line, StrokeKind::Middle);
            }
            (Tool::Lasso, Some(_), _) => _ = painter.add(Shape::closed_line(stroke.iter().map(place).collect(), line)),
            (Tool::Sphere, Some((from, to)), _) => _ = painter.circle_stroke(from, from.distance(to), line),
            (Tool::Polygon, ..) => {
                let corners: Vec<Pos2> = edit.polygon.iter().map(place).chain(pointer).collect();
                if let (Some(first), false) = (corners.first(), edit.polygon.is_empty()) {
                    painter.circle_stroke(*first, HANDLE, line);
                    painter.line(corners, line);
                }
            }
            _ => {}
        }
    }
}

/// A handle of the box that was pressed takes the pointer before the camera does, also where the pointer has moved on within the
/// frame; whether one was.
pub fn grab_box(viewer: &Viewer, ui: &Ui, response: &Response, onto: &Onto) -> bool {
    let Some(at) = pressed(ui).filter(|_| response.is_pointer_button_down_on()) else { return false };
    let (true, Some(Tool::Box), Some(crop)) = (viewer.edit.shown, viewer.edit.tool, &viewer.edit.crop) else {
        return false;
    };
    let is_under = |&number: &usize| onto.point(place(crop, number)).is_some_and(|place| grip(place).contains(at));
    let Some(number) = (0..HANDLES).find(is_under) else { return false };
    ui.ctx().set_dragged_id(ui.scope_id().with(("box", number)));
    true
}

/// Where the main button was pressed in this frame, and is still down.
fn pressed(ui: &Ui) -> Option<Pos2> {
    ui.input(|input| input.pointer.press_origin().filter(|_| input.pointer.primary_pressed()))
}

/// The place of a handle: on a face of the box, or the last one in its middle.
fn place(crop: &CropBox, number: usize) -> DVec3 {
    if number < HANDLES - 1 { crop.face(number).0 } else { crop.center }
}

/// What can be grabbed around a handle.
fn grip(at: Pos2) -> Rect {
    Rect::from_center_size(at, Vec2::splat(2.0 * GRIP))
}

/// Handles on the faces of the box, and one in its middle that moves it across the view.
fn handles(crop: &mut CropBox, ui: &mut Ui, onto: &Onto) {
    let painter = ui.painter_at(onto.image);
    for number in 0..HANDLES - 1 {
        let (place, out) = crop.face(number);
        let Some(moved) = grab(ui, &painter, onto, place, number) else { continue };
        // The way of the handle on the screen for a short step out of the box.
        let step = 1e-3 * crop.size.max_element();
        let Some((from, to)) = onto.point(place).zip(onto.point(place + out * step)) else { continue };
        let way = (to - from) / step as f32;
        // A face that is seen head on has no way to go.
        if way.length_sq() > 1e-6 {
            crop.move_face(number, f64::from(moved.dot(way) / way.length_sq()));
        }
    }
    if let Some(moved) = grab(ui, &painter, onto, crop.center, HANDLES - 1) {
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
    let id = ui.scope_id().with(("box", number));
    let response = ui.interact(grip(at), id, Sense::drag()).on_hover_cursor(CursorIcon::Grab);
    let fill = if response.hovered() || response.dragged() { Color32::WHITE } else { BOX };
    painter.circle(at, HANDLE, fill, Stroke::new(1.5, Color32::from_black_alpha(200)));
    if !response.dragged_by(PointerButton::Primary) {
        return None;
    }
    // In the frame in which it is pressed, the pointer's way to it is none of the drag.
    let now = ui.input(|input| input.pointer.latest_pos());
    Some(pressed(ui).zip(now).map_or(response.drag_delta(), |(from, now)| now - from))
}
