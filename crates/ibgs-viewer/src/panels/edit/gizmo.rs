//! The gizmo in the picture: its lines, and the pointer that grabs and drags it.

use super::image::{AXES, BOX, HANDLE, outlined};
use crate::edit::{Gizmo, Handle};
use crate::marks::Onto;
use crate::viewer::Viewer;
use eframe::egui::{Color32, CursorIcon, Painter, Pos2, Rect, Response, Shape, Stroke, Ui, Vec2};
use glam::{DVec2, DVec3};
use ibgs_core::camera::Camera;

/// Least distance of the pointer from a line that it grabs, in points.
const GRIP: f32 = 8.0;
/// Length and half the width of an arrow's head in points.
const HEAD: [f32; 2] = [12.0, 5.0];

/// A place as shares of the image.
fn share(at: Pos2, image: Rect) -> DVec2 {
    let share = (at - image.min) / image.size();
    DVec2::new(share.x.into(), share.y.into())
}

/// The lines of a handle on the screen.
fn on_screen(gizmo: &Gizmo, handle: Handle, image: Rect) -> Vec<[Pos2; 2]> {
    let onto = Onto { camera: &gizmo.camera, image, near: 0.0 };
    let place = |[from, to]: [DVec3; 2]| {
        let (from, to) = (onto.point(from)?, onto.point(to)?);
        let head = if matches!(handle, Handle::Move(_)) { HEAD[0] * (to - from).normalized() } else { Vec2::ZERO };
        Some([from, to + head])
    };
    gizmo.lines(handle).into_iter().filter_map(place).collect()
}

/// How far a place is from a line.
fn distance(at: Pos2, [from, to]: [Pos2; 2]) -> f32 {
    let way = to - from;
    let part = if way.length_sq() > 0.0 { ((at - from).dot(way) / way.length_sq()).clamp(0.0, 1.0) } else { 0.0 };
    at.distance(from + part * way)
}

/// The handle under a place.
fn under(gizmo: &Gizmo, image: Rect, at: Pos2) -> Option<Handle> {
    let away = |handle: Handle| {
        let away = on_screen(gizmo, handle, image).into_iter().map(|line| distance(at, line)).reduce(f32::min);
        Some((handle, away.filter(|away| *away < GRIP)?))
    };
    let near = Handle::ALL.into_iter().filter_map(away);
    near.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(handle, _)| handle)
}

/// The pointer grabs a handle, before the camera takes it.
pub fn grab(viewer: &mut Viewer, ui: &Ui, response: &Response, image: Rect, camera: &Camera) {
    let (is_pressed, origin) = ui.input(|input| (input.pointer.primary_pressed(), input.pointer.press_origin()));
    let Some(at) = origin.filter(|_| is_pressed && response.is_pointer_button_down_on()) else { return };
    if let Some(gizmo) = viewer.edit.gizmo(camera, viewer.center)
        && let Some(handle) = under(&gizmo, image, at)
    {
        viewer.edit.hold(handle, &gizmo, share(at, image));
    }
}

/// The pointer drags the handle that it holds, and lets it go.
pub fn drag(viewer: &mut Viewer, ui: &Ui, response: &Response, image: Rect, camera: &Camera) {
    let is_down = response.is_pointer_button_down_on() && ui.input(|input| input.pointer.primary_down());
    let Some(gizmo) = viewer.edit.gizmo(camera, viewer.center) else {
        // It is not seen any more; what holds it may still be let go.
        if viewer.edit.held().is_some() && !is_down {
            viewer.edit.lift();
        }
        return;
    };
    let hovered = response.hover_pos().and_then(|at| under(&gizmo, image, at));
    if viewer.edit.held().or(hovered).is_some() {
        ui.ctx().set_cursor_icon(CursorIcon::Grab);
    }
    if viewer.edit.held().is_none() {
        return;
    }
    if let Some(at) = response.interact_pointer_pos() {
        viewer.edit.drag(&gizmo, share(at, image));
    }
    if !is_down {
        viewer.edit.lift();
    }
}

/// Draws the gizmo; what the pointer holds or would grab is white.
pub fn draw(viewer: &Viewer, painter: &Painter, onto: &Onto) {
    let Some(gizmo) = viewer.edit.gizmo(onto.camera, viewer.center) else { return };
    let pointer = painter.ctx().pointer_latest_pos();
    let marked = viewer.edit.held().or_else(|| under(&gizmo, onto.image, pointer?));
    for handle in Handle::ALL.into_iter().rev() {
        let color = match handle {
            _ if marked == Some(handle) => Color32::WHITE,
            Handle::Move(axis) | Handle::Turn(axis) => AXES[axis],
            Handle::Scale => BOX,
        };
        let lines = on_screen(&gizmo, handle, onto.image);
        for stroke in outlined(color) {
            lines.iter().for_each(|line| _ = painter.line_segment(*line, stroke));
        }
        for [from, to] in lines {
            match handle {
                Handle::Move(_) => head(painter, to, to - from, color),
                Handle::Scale => {
                    painter.circle(to, HANDLE, color, Stroke::new(1.5, Color32::from_black_alpha(200)));
                }
                Handle::Turn(_) => {}
            }
        }
    }
}

/// The head of an arrow.
fn head(painter: &Painter, tip: Pos2, way: Vec2, color: Color32) {
    let along = way.normalized();
    let side = HEAD[1] * along.rot90();
    let back = tip - HEAD[0] * along;
    let corners = vec![tip, back + side, back - side];
    painter.add(Shape::convex_polygon(corners, color, Stroke::new(1.0, Color32::from_black_alpha(200))));
}
