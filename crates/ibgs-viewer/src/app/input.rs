//! Flight and pointer.

use crate::keys::flight;
use crate::viewer::Viewer;
use crate::worker::Command;
use eframe::egui::{self, PointerButton, Rect, Ui, Vec2};
use glam::{DVec2, DVec3};
use web_time::Instant;

/// Radians of a drag over the height of the picture.
const TURN: f64 = 3.0;
/// Scene extents that the camera flies in a second.
const SPEED: f64 = 0.3;

impl Viewer {
    /// Flies as long as a key for that is held.
    pub(super) fn fly(&mut self, ui: &Ui) {
        if !self.takes_keys(ui.ctx()) {
            return;
        }
        let way = flight(ui.ctx());
        if way != DVec3::ZERO {
            let seconds = f64::from(ui.input(|input| input.stable_dt.min(0.1)));
            self.navigator.fly(way * SPEED * self.settings.speed * self.extent * seconds);
            self.has_moved();
        }
    }

    pub(super) fn pointer(&mut self, ui: &Ui, response: &egui::Response, image: Rect) {
        let height = image.height().min(image.width() / self.navigator.shape as f32).max(1.0);
        let delta = response.drag_delta() / height;
        let (x, y) = (f64::from(delta.x), f64::from(delta.y));
        let selects = self.edit.pointer().is_some() || self.edit.held().is_some();
        let touch = ui.input(|input| input.multi_touch());
        if let Some(touch) = touch.filter(|touch| response.rect.contains(touch.center_pos)) {
            // Two fingers pan and zoom.
            let moved = touch.translation_delta / height;
            self.navigator.pan(DVec2::new(moved.x.into(), moved.y.into()));
            self.navigator.scale(f64::from(touch.zoom_delta));
            self.has_moved();
            return;
        }
        if delta != Vec2::ZERO && !(selects && response.dragged_by(PointerButton::Primary)) {
            // Dragging moves the scene along with the pointer.
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
        let by_key = std::mem::take(&mut self.focuses) && response.hovered();
        let focus = response.double_clicked() && !selects || by_key;
        if focus || response.clicked() && !selects {
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
}
