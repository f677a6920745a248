//! The scene's views at the left.

use super::{elided, sides};
use crate::View;
use crate::marks;
use crate::theme::as_text;
use crate::viewer::Viewer;
use eframe::egui::{self, Align2, Color32, Pos2, Rect, Sense, TextStyle, TextureHandle, Ui, Vec2};

/// Height of a row in points.
const ROW: f32 = 56.0;

/// The list of views with their photos.
pub fn views(viewer: &mut Viewer, ui: &mut Ui) {
    let Some(scene) = &viewer.scene else { return };
    if scene.views.is_empty() {
        return;
    }
    let (views, mut step, mut chosen) = (&scene.views, 0, None);
    let (on_view, thumbnails) = (viewer.on_view, &mut viewer.thumbnails);
    // In a narrow window the photos alone.
    let is_narrow = sides::is_narrow(ui.ctx());
    let panel = match is_narrow {
        true => egui::Panel::left("narrow views").exact_size(88.0),
        false => egui::Panel::left("views").default_size(190.0).max_size((0.4 * ui.available_width()).max(80.0)),
    };
    panel.show(ui, |ui| {
        ui.horizontal(|ui| {
            if !is_narrow {
                ui.heading("Views");
            }
            if ui.button("<").on_hover_text("The view before. Left arrow key.").clicked() {
                step = -1;
            }
            if ui.button(">").on_hover_text("The next view. Right arrow key.").clicked() {
                step = 1;
            }
        });
        sides::in_any_place("views in any place", ui, |ui| {
            egui::ScrollArea::vertical().auto_shrink(false).show_rows(ui, ROW, views.len(), |ui, rows| {
                for index in rows {
                    let view = &views[index];
                    let kind = if view.held_out { "held out from training" } else { "trained on" };
                    let (rect, row) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::click());
                    row.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &view.name));
                    if row.clicked() {
                        chosen = Some(index);
                    }
                    let texture = thumbnails.of(ui.ctx(), index, view);
                    let is_focused = row.hovered() || row.has_focus();
                    paint(ui, rect, view, texture.as_ref(), (on_view == Some(index), is_focused, is_narrow));
                    row.on_hover_text(format!("{}, {kind}", view.name));
                }
            });
        });
    });
    if step != 0 {
        viewer.step_view(step);
    }
    if let Some(index) = chosen {
        viewer.stand_on(index);
    }
}

/// A view's photo, and its name where there is room or no photo.
fn paint(
    ui: &Ui,
    rect: Rect,
    view: &View,
    texture: Option<&TextureHandle>,
    (is_shown, is_focused, is_narrow): (bool, bool, bool),
) {
    let visuals = ui.visuals();
    let fill = match (is_shown, is_focused) {
        (true, _) => visuals.selection.bg_fill,
        (false, true) => visuals.widgets.hovered.bg_fill,
        (false, false) => Color32::TRANSPARENT,
    };
    let text = if is_shown { visuals.selection.stroke.color } else { visuals.text_color() };
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect.shrink(1.0), 3.0, fill);
    let room = Rect::from_min_size(rect.min + Vec2::splat(4.0), Vec2::new(72.0, ROW - 8.0));
    if let Some(texture) = texture {
        let size = texture.size_vec2();
        let fitted = size * (room.width() / size.x).min(room.height() / size.y);
        let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
        painter.image(texture.id(), Rect::from_center_size(room.center(), fitted), whole, Color32::WHITE);
    }
    let name = view.name.rsplit('/').next().unwrap_or(&view.name);
    if is_narrow {
        // A view without a photo has its name alone.
        if view.photo.is_none() {
            let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
            let name = elided(ui, stem, TextStyle::Small, text, room.width());
            painter.galley(room.left_center() - Vec2::new(0.0, 0.5 * name.size().y), name, text);
        }
        return;
    }
    let at = Pos2::new(room.right() + 8.0, rect.center().y);
    let name = elided(ui, name, TextStyle::Body, text, rect.right() - at.x);
    painter.galley(at - Vec2::new(0.0, 8.0 + 0.5 * name.size().y), name, text);
    let (short, color) = if view.held_out { ("test", marks::HELD_OUT) } else { ("train", marks::TRAINED) };
    let color = if is_shown { text } else { as_text(color, visuals) };
    let font = TextStyle::Small.resolve(ui.style());
    painter.text(at + Vec2::new(0.0, 9.0), Align2::LEFT_CENTER, short, font, color);
}
