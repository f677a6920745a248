//! What stands around the canvas.

mod bar;
mod edit;
mod leaving;
mod path;
mod pixel;
mod settings;
mod share;
mod sides;
mod start;
mod timeline;
mod training;
mod views;

pub use bar::{bar, status};
pub use edit::{draw as draw_edit, grab as grab_gizmo, grab_box, in_image as edit_in_image};
pub use leaving::leaving;
pub use settings::settings;
pub use sides::tabs;
pub use start::{chosen, start};

use crate::keys;
use crate::mode::Mode;
use crate::viewer::{Over, Viewer};
use eframe::egui::{
    self, Align2, Color32, Context, CursorIcon, FontId, Galley, Painter, Pos2, Rect, RichText, ScrollArea, Sense,
    Slider, Stroke, StrokeKind, TextStyle, TextWrapMode, Ui, Vec2, WidgetText,
};
use ibgs_core::gpu::Bytes;
use ibgs_core::local_space::Length;
use ibgs_core::picture::{MOST_VISIBLE, visibility_color};
use std::sync::Arc;
use std::time::Duration;

/// Where panels over the picture begin below the window's edge, in points.
const TOP: f32 = 48.0;
/// After this time without a new picture the old one says that it is old.
const SLOW: Duration = Duration::from_millis(500);
/// How dark the ground of text over the picture is.
const GROUND: u8 = 150;

/// The panels left, right and below.
pub fn around(viewer: &mut Viewer, ui: &mut Ui) {
    viewer.thumbnails.begin();
    // First, so that it has the whole width.
    timeline::timeline(viewer, ui);
    sides::sides(viewer, ui);
    share::share(viewer, ui.ctx());
    help(viewer, ui);
}

/// A panel over the picture, in the middle at first.
fn floating<'open>(title: &str, ctx: &Context) -> egui::Window<'open> {
    let top = ctx.content_rect().center_top() + Vec2::new(0.0, TOP);
    let window = egui::Window::new(title).collapsible(false).resizable(false).default_height(floating_height(ctx));
    window.pivot(Align2::CENTER_TOP).default_pos(top)
}

/// Largest height of such a panel.
fn floating_height(ctx: &Context) -> f32 {
    (ctx.content_rect().height() - 2.0 * TOP).max(TOP)
}

/// What such a panel holds; a low window scrolls it.
fn scrolled(ui: &mut Ui, content: impl FnOnce(&mut Ui)) {
    ScrollArea::vertical().max_height(floating_height(ui.ctx())).show(ui, content);
}

/// A text in one line of a width, which ends in dots where it is longer.
fn elided(ui: &Ui, text: &str, style: TextStyle, color: Color32, width: f32) -> Arc<Galley> {
    let text = WidgetText::from(RichText::new(text).text_style(style.clone()).color(color));
    text.into_galley(ui, Some(TextWrapMode::Truncate), width, style)
}

/// The line between two modes, which can be dragged.
pub fn divider(viewer: &mut Viewer, ui: &mut Ui, image: Rect) {
    let Some(other) = viewer.other else { return };
    let x = image.left() + viewer.divider * image.width();
    viewer.divider_x = Some(x);
    let grip = Rect::from_x_y_ranges(x - 5.0..=x + 5.0, image.y_range());
    let response =
        ui.interact(grip, ui.scope_id().with("divider"), Sense::drag()).on_hover_cursor(CursorIcon::ResizeHorizontal);
    if response.dragged()
        && let Some(at) = response.interact_pointer_pos()
    {
        viewer.divider = ((at.x - image.left()) / image.width().max(1.0)).clamp(0.02, 0.98);
    }
    let painter = ui.painter_at(image);
    painter.vline(x, image.y_range(), Stroke::new(3.0, Color32::from_black_alpha(160)));
    painter.vline(x, image.y_range(), Stroke::new(1.0, Color32::WHITE));
    for (mode, align, way) in [(viewer.mode, Align2::RIGHT_BOTTOM, -8.0), (other, Align2::LEFT_BOTTOM, 8.0)] {
        let at = egui::pos2(x + way, image.bottom() - 8.0);
        label(&painter, at, align, mode.name().to_owned());
    }
}

/// White text on a dark ground, seen on any picture; returns the room that it takes.
fn label(painter: &Painter, at: Pos2, align: Align2, text: String) -> Rect {
    let galley = painter.layout_no_wrap(text, FontId::proportional(13.0), Color32::WHITE);
    let room = align.anchor_size(at, galley.size());
    painter.rect_filled(room.expand(4.0), 3.0, Color32::from_black_alpha(GROUND));
    painter.galley(room.min, galley, Color32::WHITE);
    room
}

/// The slider that amplifies differences, over the picture.
pub fn strength(viewer: &mut Viewer, ui: &Ui, room: Rect) {
    if !viewer.shows(Mode::has_gain) {
        return;
    }
    // Beside the figures, or below them.
    let top = if room.width() < sides::NARROW { 52.0 } else { 12.0 };
    let at = room.right_top() + Vec2::new(-12.0, top);
    egui::Area::new(ui.scope_id().with("strength")).fixed_pos(at).pivot(Align2::RIGHT_TOP).show(ui.ctx(), |ui| {
        egui::Frame::popup(ui.style()).show(ui, |ui| {
            let slider = Slider::new(&mut viewer.canvas.style.gain, 1.0..=20.0).logarithmic(true).text("strength");
            ui.add(slider).on_hover_text("Factor that amplifies differences");
        });
    });
}

/// What is to be known of the picture, in the canvas' corner.
pub fn overlay(viewer: &Viewer, ui: &Ui, room: Rect) {
    let painter = ui.painter_at(room);
    if let Some(rest) = viewer.canvas.waits().map(|waits| SLOW.checked_sub(waits)) {
        match rest {
            Some(rest) => ui.ctx().request_repaint_after(rest),
            None => {
                let at = room.center_bottom() - Vec2::new(0.0, 12.0);
                label(&painter, at, Align2::CENTER_BOTTOM, "rendering; this is the picture before".to_owned());
            }
        }
    }
    let mut lines = if viewer.panels.hides_figures { Vec::new() } else { figures(viewer) };
    if viewer.shows(Mode::needs_network) && viewer.lacks_sources() {
        lines.push("no photo near: base image".to_owned());
    }
    if viewer.misses_gizmo() {
        lines.push("the gizmo is outside of the picture".to_owned());
    }
    let mut at = room.min + Vec2::splat(12.0);
    if !lines.is_empty() {
        at.y = label(&painter, at, Align2::LEFT_TOP, lines.join("\n")).bottom() + 12.0;
    }
    if let Some(last) = viewer.canvas.last().filter(|_| viewer.shows(|mode| mode == Mode::Visibility)) {
        legend(&painter, at, last.facts.most_sources);
    }
}

/// Size, time and memory of the picture.
fn figures(viewer: &Viewer) -> Vec<String> {
    let Some(last) = viewer.canvas.last() else { return vec!["rendering ...".to_owned()] };
    let camera = last.frame.camera();
    let ms = 1e3 * last.time.as_secs_f64();
    let fps = 1e3 / ms.max(1e-3);
    let decimals = usize::from(fps < 10.0);
    let memory = last.memory.map_or(String::new(), |bytes| format!("   {}", Bytes(bytes)));
    let mut lines = vec![
        format!("{} x {}   {ms:.1} ms   {fps:.decimals$} FPS", camera.width, camera.height),
        format!("{} Gaussians{memory}", last.facts.gaussians),
    ];
    if viewer.shows(Mode::has_range) {
        let [near, far] = viewer.canvas.style.depth_range;
        let [near, far] = [near, far].map(|z| Length(z.into()));
        lines.push(format!("depth {near} (bright) to {far} (dark)"));
    }
    lines
}

/// The colours of numbers of visible source photos.
fn legend(painter: &Painter, at: Pos2, most: u32) {
    let text = |text: String| painter.layout_no_wrap(text, FontId::proportional(13.0), Color32::WHITE);
    let entries: Vec<_> = (0..=most)
        .map(|count| {
            let [r, g, b] = visibility_color(count, MOST_VISIBLE);
            (Color32::from_rgb(r, g, b), text(count.to_string()))
        })
        .collect();
    let title = text("visible source photos".to_owned());
    let (height, gap) = (title.size().y, 6.0);
    let width = |number: f32| height + number + 3.0 * gap;
    let all = title.size().x + entries.iter().map(|(_, number)| width(number.size().x)).sum::<f32>();
    let room = Rect::from_min_size(at, Vec2::new(all, height));
    painter.rect_filled(room.expand(4.0), 3.0, Color32::from_black_alpha(GROUND));
    let mut x = at.x + title.size().x + 2.0 * gap;
    painter.galley(at, title, Color32::WHITE);
    for (color, number) in entries {
        let patch = Rect::from_min_size(Pos2::new(x, at.y), Vec2::splat(height)).shrink(1.0);
        painter.rect(patch, 2.0, color, Stroke::new(1.0, Color32::WHITE), StrokeKind::Inside);
        let after = x + width(number.size().x);
        painter.galley(Pos2::new(x + height + gap, at.y), number, Color32::WHITE);
        x = after;
    }
}

fn help(viewer: &mut Viewer, ui: &mut Ui) {
    let mut open = viewer.panels.over == Some(Over::Help);
    let ctx = ui.ctx();
    let width = ctx.content_rect().width();
    floating("Keys and pointer", ctx).open(&mut open).max_width(width - 32.0).show(ctx, |ui| {
        scrolled(ui, |ui| {
            if width < sides::SMALL {
                for (key, what) in keys::help() {
                    ui.strong(key);
                    ui.label(what);
                    ui.add_space(4.0);
                }
                return;
            }
            egui::Grid::new("keys").num_columns(2).striped(true).show(ui, |ui| {
                for (key, what) in keys::help() {
                    ui.strong(key);
                    ui.label(what);
                    ui.end_row();
                }
            });
        });
    });
    viewer.panels.put_over(Over::Help, open);
}
