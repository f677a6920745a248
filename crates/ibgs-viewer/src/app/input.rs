//! Keys and pointer.

use crate::IN_BROWSER;
use crate::mode::Mode;
use crate::panels;
use crate::viewer::Viewer;
use crate::worker::Command;
use eframe::egui::{self, Key, PointerButton, Rect, Ui, Vec2};
use glam::{DVec2, DVec3};
use web_time::Instant;

/// Radians of a drag over the height of the canvas.
const TURN: f64 = 3.0;
/// Scene extents that the camera flies in a second.
const SPEED: f64 = 0.3;
/// Keys that do something once.
const SINGLE_KEYS: [Key; 8] =
    [Key::ArrowLeft, Key::ArrowRight, Key::R, Key::C, Key::P, Key::K, Key::Space, Key::Escape];

/// Keys that fly, with their direction: right, down, forward.
const FLY_KEYS: [(Key, DVec3); 6] = [
    (Key::W, DVec3::Z),
    (Key::S, DVec3::NEG_Z),
    (Key::D, DVec3::X),
    (Key::A, DVec3::NEG_X),
    (Key::E, DVec3::NEG_Y),
    (Key::Q, DVec3::Y),
];

impl Viewer {
    pub(super) fn keys(&mut self, ui: &Ui) {
        if ui.ctx().egui_wants_keyboard_input() || self.scene.is_none() {
            return;
        }
        if !IN_BROWSER {
            panels::edit_keys(self, ui.ctx());
        }
        // A widget that was reached by Tab takes these itself.
        let focused = ui.memory(|memory| memory.focused().is_some());
        let (pressed, down, shift, dt) = ui.input(|input| {
            let taken = |key| focused && matches!(key, Key::Space | Key::ArrowLeft | Key::ArrowRight);
            let modes = Mode::ALL.into_iter().filter_map(Mode::key);
            let keys = modes.chain(SINGLE_KEYS).filter(|&key| !taken(key));
            let command = input.modifiers.command || input.modifiers.ctrl || input.modifiers.alt;
            let pressed: Vec<Key> = keys.filter(|&key| !command && input.key_pressed(key)).collect();
            let fly = FLY_KEYS.iter().filter(|(key, _)| !command && input.key_down(*key));
            let down: DVec3 = fly.map(|(_, direction)| *direction).sum();
            (pressed, down, input.modifiers.shift, f64::from(input.stable_dt.min(0.1)))
        });
        for key in pressed {
            match key {
                Key::ArrowLeft => self.step_view(-1),
                Key::ArrowRight => self.step_view(1),
                Key::R => self.reset(),
                Key::C => self.panels.shows_cameras = !self.panels.shows_cameras,
                Key::P | Key::K if IN_BROWSER => {}
                Key::P => self.screenshot(),
                Key::K => self.panels.path.add(&self.navigator),
                Key::Space => self.panels.path.toggle(),
                Key::Escape => (self.found, self.other) = (None, None),
                _ => {
                    let wanted = Mode::ALL.into_iter().find(|mode| mode.key() == Some(key));
                    wanted.into_iter().for_each(|mode| self.show_mode(mode));
                }
            }
        }
        if down != DVec3::ZERO {
            let speed = SPEED * self.extent * if shift { 4.0 } else { 1.0 };
            self.navigator.fly(down * speed * dt);
            self.has_moved();
        }
    }

    pub(super) fn pointer(&mut self, ui: &Ui, response: &egui::Response, image: Rect) {
        let delta = response.drag_delta() / image.height().max(1.0);
        let (x, y) = (f64::from(delta.x), f64::from(delta.y));
        let selects = self.edit.pointer().is_some();
        let touch = ui.input(|input| input.multi_touch());
        if let Some(touch) = touch.filter(|touch| response.rect.contains(touch.center_pos)) {
            // Two fingers pan and zoom.
            let moved = touch.translation_delta / image.height().max(1.0);
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
        let pressed_f = || response.hovered() && ui.input(|input| input.key_pressed(Key::F));
        let focus = response.double_clicked() && !selects || pressed_f();
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
