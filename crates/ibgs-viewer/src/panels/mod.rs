//! What stands around the canvas.

mod bar;
mod edit;
mod leaving;
mod path;
mod pixel;
mod share;
mod start;
mod timeline;
mod training;
mod views;

pub use bar::{bar, status};
pub use edit::{draw as draw_edit, in_image as edit_in_image, keys as edit_keys};
pub use leaving::leaving;
pub use start::{chosen, start};

use crate::mode::Mode;
use crate::viewer::Viewer;
use eframe::egui::{self, Align2, Color32, CursorIcon, FontId, Rect, Sense, Slider, Stroke, Ui, Vec2};
use ibgs_core::gpu::Bytes;
use ibgs_core::local_space::Length;
use std::time::Duration;

/// Windows that are narrower, in points, have below the image what others have beside it.
const NARROW: f32 = 480.0;
/// After this time without a new picture the old one says that it is old.
const SLOW: Duration = Duration::from_millis(500);

/// The panels left, right and below.
pub fn around(viewer: &mut Viewer, ui: &mut Ui) {
    viewer.thumbnails.begin();
    // First, so that it has the whole width.
    timeline::timeline(viewer, ui);
    views::views(viewer, ui);
    let shows_pixel = viewer.panels.shows_pixel && viewer.found.is_some();
    if viewer.training.is_some() || shows_pixel || viewer.panels.shows_path || viewer.edit.shown {
        // On a phone the canvas would be nothing but a stripe beside it.
        let panel = match ui.ctx().content_rect().width() < NARROW {
            true => {
                let most = (0.35 * ui.available_height()).max(80.0);
                egui::Panel::bottom("facts below").default_size(200.0_f32.min(most)).max_size(most)
            }
            false => {
                let most = (0.5 * ui.available_width()).max(120.0);
                egui::Panel::right("facts").default_size(300.0_f32.min(most)).max_size(most)
            }
        };
        panel.show(ui, |ui| {
            egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
                training::training(viewer, ui);
                edit::panel(viewer, ui);
                if viewer.panels.shows_path {
                    path::panel(viewer, ui);
                }
                if shows_pixel {
                    pixel::pixel(viewer, ui);
                }
            });
        });
    }
    if shows_pixel {
        pixel::strip(viewer, ui);
    }
    share::share(viewer, ui.ctx());
    help(viewer, ui);
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

/// White text on a dark ground, seen on any picture.
fn label(painter: &egui::Painter, at: egui::Pos2, align: Align2, text: String) {
    let galley = painter.layout_no_wrap(text, FontId::proportional(13.0), Color32::WHITE);
    let room = align.anchor_size(at, galley.size());
    painter.rect_filled(room.expand(4.0), 3.0, Color32::from_black_alpha(150));
    painter.galley(room.min, galley, Color32::WHITE);
}

/// The slider that amplifies differences, over the picture.
pub fn strength(viewer: &mut Viewer, ui: &Ui, room: Rect) {
    if !viewer.shows(Mode::has_gain) {
        return;
    }
    let at = room.right_top() + Vec2::new(-12.0, 12.0);
    egui::Area::new(ui.scope_id().with("strength")).fixed_pos(at).pivot(Align2::RIGHT_TOP).show(ui.ctx(), |ui| {
        egui::Frame::popup(ui.style()).show(ui, |ui| {
            let slider = Slider::new(&mut viewer.canvas.style.gain, 1.0..=20.0).logarithmic(true).text("strength");
            ui.add(slider).on_hover_text("Factor that amplifies differences");
        });
    });
}

/// Figures in the canvas' corner.
pub fn overlay(viewer: &Viewer, ui: &Ui, room: Rect) {
    if let Some(rest) = viewer.canvas.waits().map(|waits| SLOW.checked_sub(waits)) {
        match rest {
            Some(rest) => ui.ctx().request_repaint_after(rest),
            None => {
                let at = room.center_bottom() - Vec2::new(0.0, 12.0);
                label(
                    &ui.painter_at(room),
                    at,
                    Align2::CENTER_BOTTOM,
                    "rendering; this is the picture before".to_owned(),
                );
            }
        }
    }
    if viewer.panels.hides_figures {
        return;
    }
    let Some(last) = viewer.canvas.last() else {
        return label(&ui.painter_at(room), room.min + Vec2::splat(12.0), Align2::LEFT_TOP, "rendering ...".to_owned());
    };
    let camera = last.frame.camera();
    let ms = 1e3 * last.time.as_secs_f64();
    let fps = 1e3 / ms.max(1e-3);
    let decimals = usize::from(fps < 10.0);
    let mut text = format!(
        "{} x {}   {ms:.1} ms   {fps:.decimals$} FPS\n{} Gaussians",
        camera.width, camera.height, last.facts.gaussians
    );
    if let Some(bytes) = last.memory {
        text += &format!("   {}", Bytes(bytes));
    }
    if viewer.shows(Mode::has_range) {
        let [near, far] = viewer.canvas.style.depth_range;
        let [near, far] = [near, far].map(|z| Length(z.into()));
        text += &format!("\ndepth {near} (bright) to {far} (dark)");
    }
    if viewer.shows(|mode| mode == Mode::Visibility) {
        text += &format!("\nvisible source photos: none (black), 1 (dark) to {} (bright)", last.facts.most_sources);
    }
    label(&ui.painter_at(room), room.min + Vec2::splat(12.0), Align2::LEFT_TOP, text);
}

const HELP: [(&str, &str); 22] = [
    ("Left drag", "orbit around the point in the middle"),
    ("Right drag", "look around"),
    ("Middle drag", "move sideways"),
    ("Wheel", "nearer or farther"),
    ("W A S D, Q E", "fly, down and up; with Shift faster"),
    ("Double click, F", "turn to a point of the surface and orbit around it"),
    ("Click", "see why a pixel looks as it does"),
    ("1 to 9, 0", "what is shown"),
    ("Left, Right", "the view before, the next view"),
    ("R", "back to the first view"),
    ("C", "show the scene's cameras"),
    ("K, Space", "add a keyframe, play the camera path"),
    ("P", "write a screenshot"),
    ("Escape", "leave the tool; select nothing; close the pixel and the split view"),
    ("X", "edit the model"),
    ("Shift, Ctrl or Alt", "add to the selection, take away from it"),
    ("Ctrl+A, Ctrl+I", "select all, select the others"),
    ("Delete", "delete the selected Gaussians"),
    ("H, Shift+H", "hide the selected ones, show all"),
    ("L, Shift+L", "lock the selected ones, unlock all"),
    ("Enter", "end the polygon"),
    ("Ctrl+Z, Ctrl+Shift+Z", "undo, redo"),
];

fn help(viewer: &mut Viewer, ui: &mut Ui) {
    let mut open = viewer.panels.shows_help;
    egui::Window::new("Keys and pointer").open(&mut open).collapsible(false).resizable(false).vscroll(true).show(
        ui.ctx(),
        |ui| {
            egui::Grid::new("keys").num_columns(2).striped(true).show(ui, |ui| {
                for (key, what) in HELP {
                    ui.strong(key);
                    ui.label(what);
                    ui.end_row();
                }
            });
        },
    );
    viewer.panels.shows_help = open;
}
