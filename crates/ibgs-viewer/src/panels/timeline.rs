//! The camera path's keyframes as pictures in a row, with the time of each way between them.

use crate::navigator::Navigator;
use crate::path_editor::{PathEditor, Picture};
use crate::thumbnails::paint;
use crate::viewer::Viewer;
use eframe::egui::{
    self, Align2, Button, DragValue, Id, Label, Rect, RichText, Role, ScrollArea, Sense, Slider, SliderClamping,
    Stroke, TextStyle, Ui, Vec2, WidgetInfo,
};

/// Size of a keyframe's picture in points, and of the line below it.
const PICTURE: Vec2 = Vec2::new(96.0, 54.0);
const LINE: f32 = 18.0;
/// Share of the width that the slider along the path has, at least 100 points.
const SLIDER: f32 = 0.4;
/// Width of the time between two pictures.
const WAY: f32 = 48.0;

/// The panel below the canvas.
pub fn timeline(viewer: &mut Viewer, ui: &mut Ui) {
    if !viewer.panels.shows_path {
        return;
    }
    let navigator = viewer.navigator;
    let editor = &mut viewer.panels.path;
    egui::Panel::bottom("timeline").show(ui, |ui| {
        ui.horizontal_wrapped(|ui| controls(editor, &navigator, ui));
        ScrollArea::horizontal().auto_shrink([false, true]).show(ui, |ui| row(editor, ui));
    });
}

/// Preview, and what is done with the keyframe that it stands at.
fn controls(editor: &mut PathEditor, navigator: &Navigator, ui: &mut Ui) {
    let name = if editor.playing { "Stop" } else { "Play" };
    let play = ui.add_enabled(editor.keyframes() > 1, Button::new(name));
    if play.on_hover_text("Key Space").clicked() {
        editor.toggle();
    }
    let (seconds, any) = (editor.path.seconds, editor.keyframes() > 0);
    // The path may have become shorter.
    editor.at = editor.at.min(seconds);
    ui.spacing_mut().slider_width = (SLIDER * ui.available_width()).max(100.0);
    // It may stand between two of its own steps.
    let slider = Slider::new(&mut editor.at, 0.0..=seconds).clamping(SliderClamping::Edits);
    if ui.add_enabled(any, slider.suffix(" s").fixed_decimals(2)).on_hover_text("Move along the path").changed() {
        (editor.moved, editor.playing) = (true, false);
    }
    let Some(current) = editor.current(&editor.path.times()) else {
        if !any {
            ui.label("Key K adds a keyframe where the camera is.");
        }
        return;
    };
    ui.label(format!("keyframe {}:", current + 1));
    if ui.button("Set").on_hover_text("Move it to where the camera is now").clicked() {
        editor.set(current, navigator);
    }
    if ui.button("Remove").clicked() {
        editor.remove(current);
    }
}

/// The keyframes; each can be dragged to another place.
fn row(editor: &mut PathEditor, ui: &mut Ui) {
    let times = editor.path.times();
    let current = editor.current(&times);
    let (mut middles, mut shown, mut released) = (Vec::new(), None, None);
    let (pointer, is_down) = ui.input(|input| (input.pointer.latest_pos(), input.pointer.any_down()));
    let response = ui.horizontal(|ui| {
        for (index, &time) in times.iter().enumerate().take(editor.keyframes()) {
            if index > 0 {
                way(editor, index, time - times[index - 1], ui);
            }
            let tile = tile(editor, (index, time), current == Some(index), ui);
            middles.push(tile.rect.center().x);
            if tile.drag_started() {
                editor.dragged = Some(index);
            }
            if tile.clicked() {
                shown = Some(index);
            }
            if tile.drag_stopped() {
                released = editor.dragged.take();
            }
        }
        if let [.., last, end] = times[..]
            && editor.path.cycle
        {
            way(editor, 0, end - last, ui);
        }
    });
    if !is_down {
        editor.dragged = None;
    }
    // The place among the others that the pointer is at.
    let place = |from: usize| {
        let x = pointer?.x;
        Some(middles.iter().enumerate().filter(|&(i, &middle)| i != from && middle < x).count())
    };
    if let Some((from, to)) = editor.dragged.and_then(|from| Some((from, place(from)?)))
        && let Some(last) = middles.last()
    {
        let edge = if to <= from { to } else { to + 1 };
        let half = 0.5 * PICTURE.x + 4.0;
        let x = middles.get(edge).map_or(last + half, |middle| middle - half);
        ui.painter().vline(x, response.response.rect.y_range(), Stroke::new(3.0, ui.visuals().selection.bg_fill));
    }
    if let Some((from, to)) = released.and_then(|from| Some((from, place(from)?))).filter(|(from, to)| from != to) {
        editor.reorder(from, to);
    }
    if let Some(index) = shown {
        editor.go_to(index);
    }
}

/// The time of the way to a keyframe.
fn way(editor: &mut PathEditor, index: usize, mut seconds: f64, ui: &mut Ui) {
    let (room, _) = ui.allocate_exact_size(Vec2::new(WAY, PICTURE.y + LINE), Sense::hover());
    if !ui.is_rect_visible(room) {
        return;
    }
    let field = Rect::from_center_size(room.center_top() + Vec2::new(0.0, 0.5 * PICTURE.y), Vec2::new(WAY, LINE));
    let value = DragValue::new(&mut seconds).range(0.1..=600.0).clamp_existing_to_range(false);
    let value = value.speed(0.05).fixed_decimals(1).suffix(" s");
    if ui.put(field, value).on_hover_text(format!("Time of the way to keyframe {}", index + 1)).changed() {
        editor.set_way(index, seconds);
    }
    let below = Rect::from_min_max(room.left_top() + Vec2::new(0.0, PICTURE.y), room.max);
    ui.put(below, Label::new(RichText::new(format!("to {}", index + 1)).small()));
}

/// A keyframe: what is seen from there, its number and its time.
fn tile(editor: &PathEditor, (index, time): (usize, f64), is_current: bool, ui: &mut Ui) -> egui::Response {
    let (rect, _) = ui.allocate_exact_size(PICTURE + Vec2::new(0.0, LINE), Sense::hover());
    let response = ui.interact(rect, Id::unique(("keyframe", index)), Sense::click_and_drag());
    let number = (index + 1).to_string();
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &number));
    if !ui.is_rect_visible(rect) {
        return response;
    }
    let (visuals, painter) = (ui.visuals(), ui.painter_at(rect.expand(2.0)));
    let room = Rect::from_min_size(rect.min, PICTURE);
    painter.rect_filled(room, 3.0, visuals.extreme_bg_color);
    match &editor.pictures[index] {
        Picture::There(picture) => paint(&painter, picture, room),
        _ => {
            let font = TextStyle::Heading.resolve(ui.style());
            painter.text(room.center(), Align2::CENTER_CENTER, &number, font, visuals.weak_text_color());
        }
    }
    let stroke = match is_current || response.hovered() || response.has_focus() {
        true => Stroke::new(2.0, visuals.selection.bg_fill),
        false => visuals.widgets.noninteractive.bg_stroke,
    };
    painter.rect_stroke(room, 3.0, stroke, egui::StrokeKind::Inside);
    let text = format!("{number}   {time:.1} s");
    let at = egui::pos2(room.center().x, room.bottom() + 2.0);
    painter.text(at, Align2::CENTER_TOP, text, TextStyle::Small.resolve(ui.style()), visuals.text_color());
    response.on_hover_text("Click: go there. Drag: another place in the order.")
}
