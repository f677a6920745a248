//! The middle of the window: which frame is asked for, and the picture with all that is drawn over it.

use crate::canvas::{CanvasRequest, SIDES};
use crate::looks::Look;
use crate::marks::{self, Onto};
use crate::mode::Mode;
use crate::panels;
use crate::viewer::{Viewer, fitted, inscribed, widened};
use crate::worker::{Command, Rendered};
use eframe::egui::emath::GuiRounding;
use eframe::egui::{self, Color32, Painter, Pos2, Rect, Sense, Stroke, StrokeKind, Ui};
use eframe::egui_wgpu::RenderState;
use ibgs_core::camera::Camera;
use ibgs_core::gpu::GpuError;
use std::time::Duration;

impl Viewer {
    /// The camera of the canvas: it fills the room. That of a view keeps its image in the middle, and has its very size where the
    /// photo is compared with.
    fn camera(&self) -> Camera {
        let [width, height] = self.room;
        let Some(view) = self.view() else { return self.navigator.camera(width, height) };
        if self.shows(Mode::needs_photo) {
            return view.camera;
        }
        let own = inscribed(&view.camera, self.room);
        if self.panels.only_frame { own } else { widened(&own, self.room) }
    }

    /// Whether the gizmo is taken up, and outside of the picture.
    pub(crate) fn misses_gizmo(&self) -> bool {
        self.edit.uses_gizmo() && self.edit.gizmo(&self.camera(), self.center).is_none()
    }

    fn wanted(&self, camera: Camera) -> CanvasRequest {
        CanvasRequest {
            camera,
            moving: self.moving(),
            exact: self.view().is_some() && self.shows(Mode::needs_photo),
            always_sharp: self.settings.always_sharp,
            background: self.settings.background(),
            with_range: self.shows(Mode::has_range) || self.edit.needs_depths(),
            looks: Look::ALL.map(|look| self.shows(|mode| mode.look() == Some(look))),
            iteration: self.training.as_ref().map_or(self.edit.revision, |trained| trained.progress.iteration),
            running: self.training.as_ref().is_some_and(|trained| trained.running),
        }
    }

    /// Paints the last frame in the modes that are shown.
    fn paint(&mut self, state: &RenderState, painter: &Painter, room: Rect) -> Result<(), GpuError> {
        let photo = self.photo()?;
        let split = if self.other.is_some() { self.divider } else { 1.0 };
        let sides = [Some((self.mode, 0.0, split)), self.other.map(|other| (other, split, 1.0))];
        for (number, (mode, from, to)) in sides.into_iter().enumerate().filter_map(|(i, side)| Some((i, side?))) {
            if let Some(texture) = self.canvas.texture(state, number, mode, photo.as_ref())? {
                let at = |share: f32| room.left() + share * room.width();
                let part = Rect::from_min_max(Pos2::new(at(from), room.top()), Pos2::new(at(to), room.bottom()));
                let whole = Rect::from_min_max(Pos2::new(from, 0.0), Pos2::new(to, 1.0));
                painter.image(texture, part, whole, Color32::WHITE);
            }
        }
        Ok(())
    }

    pub(super) fn central(&mut self, ui: &mut Ui, frame: &eframe::Frame) -> Result<(), GpuError> {
        let scale = ui.ctx().pixels_per_point();
        let room = ui.available_rect_before_wrap().round_to_pixels(scale);
        let fitted = |ratio| fitted(room, ratio, scale);
        self.panels.picture = Some(room);
        // The click that closes a menu does nothing else.
        let sense = if self.panels.had_menu { Sense::hover() } else { Sense::click_and_drag() };
        let response = ui.allocate_rect(room, sense);
        let response = response.on_hover_cursor(egui::CursorIcon::Crosshair);
        let pixels = room.size() * scale;
        self.room = [pixels.x, pixels.y].map(|length| (length.round() as u32).clamp(SIDES[0], SIDES[1]));
        self.follow_placement();
        let camera = self.camera();
        panels::grab_gizmo(self, ui, &response, fitted(ratio(&camera)), &camera);
        if !panels::grab_box(self, ui, &response, &Onto::new(&camera, fitted(ratio(&camera)), self.extent)) {
            self.pointer(ui, &response, fitted(ratio(&camera)));
        }
        if let Some(pose) = self.panels.path.pose(ui) {
            self.has_moved();
            self.navigator.follow(&pose);
        }
        let camera = self.camera();
        let image = fitted(ratio(&camera));
        let wanted = self.wanted(camera);
        let Some(state) = frame.wgpu_render_state() else { return Ok(()) };
        // A device that has failed once returns nothing.
        if self.gpu.check().is_ok()
            && let Some(request) = self.canvas.request(&wanted)
        {
            let sheet = self.canvas.sheet(state, &request, self.mode);
            self.send(Command::Render(Box::new(request), sheet));
        }
        let painter = ui.painter_at(room);
        painter.rect_filled(room, 0.0, ui.visuals().extreme_bg_color);
        // A picture of another shape keeps it until the awaited one comes.
        let drawn = match self.canvas.last().map(|last| ratio(last.frame.camera())) {
            Some(last) if (last / ratio(&camera) - 1.0).abs() > 0.02 => fitted(last),
            _ => image,
        };
        self.paint(state, &painter, drawn)?;
        if let Some(view) = self.view().filter(|_| !self.panels.only_frame) {
            outline(&painter, fitted(ratio(&view.camera)));
        }
        let over = painter.with_clip_rect(image.intersect(painter.clip_rect()));
        let onto = Onto::new(&camera, image, self.extent);
        marks::draw(self, &over, &onto);
        panels::draw_edit(self, &over, &onto);
        self.panels.path.draw(|ends, stroke| onto.line(&over, ends, stroke));
        panels::divider(self, ui, image);
        panels::edit_in_image(self, ui, &response, image, &camera);
        panels::overlay(self, ui, room);
        panels::strength(self, ui, room);
        panels::tabs(self, ui, room);
        self.picture_keyframes();
        let is_outdated = |last: &Rendered| last.iteration != wanted.iteration || last.facts.is_loading;
        let outdated = self.canvas.last().is_some_and(is_outdated);
        if self.moving() || outdated {
            ui.ctx().request_repaint_after(Duration::from_millis(20));
        }
        Ok(())
    }
}

/// Width over height.
fn ratio(camera: &Camera) -> f32 {
    camera.width as f32 / camera.height as f32
}

/// A thin line around a photo's part of the picture, seen on any colour.
fn outline(painter: &Painter, frame: Rect) {
    for (more, color) in [(1.0, Color32::from_black_alpha(140)), (0.0, Color32::from_white_alpha(140))] {
        painter.rect_stroke(frame.expand(more), 0.0, Stroke::new(1.0, color), StrokeKind::Outside);
    }
}
