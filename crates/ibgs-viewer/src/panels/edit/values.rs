//! Selecting by values, with a histogram, and what floats.

use crate::edit::{Edit, Quantity};
use crate::viewer::Viewer;
use crate::worker::Command;
use eframe::egui::{Button, DragValue, Rect, Role, Sense, Slider, Ui, Vec2, WidgetInfo, pos2};
use ibgs_core::edit::{Editor, Histogram, Value};

/// Height of a histogram in points.
const HEIGHT: f32 = 64.0;

/// A value, its histogram, and the range to select.
pub fn ranges(viewer: &mut Viewer, ui: &mut Ui) {
    if let Some(command) = quantities(viewer, ui) {
        viewer.send(command);
    }
    let edit = &mut viewer.edit;
    let (Some(editor), Some(value)) = (&edit.editor, edit.ranges.value) else { return };
    let Some(histogram) = edit.ranges.histogram(editor.shown()).cloned() else {
        waiting(edit, ui);
        return;
    };
    let range = edit.ranges.range.get_or_insert(histogram.ends);
    bars(&histogram, range, ui);
    ui.horizontal_wrapped(|ui| {
        let [low, high] = histogram.ends;
        let speed = if value.is_logarithmic() { 0.002 * high } else { (high - low) / 300.0 };
        let decimals = match value {
            Quantity::Own(Value::Photos) => 0,
            Quantity::Own(_) => 4,
            Quantity::Error => 6,
        };
        for (end, name) in range.iter_mut().zip(["from ", "to "]) {
            ui.add(DragValue::new(end).prefix(name).speed(speed).range(low..=high).max_decimals(decimals));
        }
    });
    if ui.button("Select by values").on_hover_text("The Gaussians in the range, its ends included").clicked()
        && let Some(found) = edit.ranges.found()
    {
        let how = edit.how;
        edit.step(|editor: &mut Editor| editor.select(&found, how));
    }
}

/// What stands in place of a histogram.
fn waiting(edit: &Edit, ui: &mut Ui) {
    if !edit.ranges.is_waiting() {
        if edit.ranges.has_no_photos {
            ui.label("There are no photos to compare with: they are not where the model was opened.");
        }
        return;
    }
    ui.horizontal(|ui| {
        ui.spinner();
        if let Some([done, count]) = edit.ranges.compared {
            ui.label(format!("{done} of {count} photos compared"));
        }
    });
}

/// The buttons that choose what is looked at.
fn quantities(viewer: &mut Viewer, ui: &mut Ui) -> Option<Command> {
    let Viewer { edit, scene, .. } = viewer;
    let editor = edit.editor.as_ref()?;
    let views = || scene.iter().flat_map(|scene| &scene.views);
    let all = [
        (Value::Opacity, "Opacity", "From 0 to 1"),
        (Value::Size, "Size", "Largest standard deviation in scene units"),
        (Value::Distance, "Distance", "From the middle of the cameras, in scene units"),
        (Value::Photos, "Photos", "Number of photos within whose frame a Gaussian lies, hidden there or not"),
    ];
    let has_views = views().next().is_some();
    let mut command = None;
    ui.horizontal_wrapped(|ui| {
        for (value, name, text) in all.into_iter().filter(|(value, ..)| *value != Value::Photos || has_views) {
            let is_shown = edit.ranges.value == Some(Quantity::Own(value));
            if ui.selectable_label(is_shown, name).on_hover_text(text).clicked() {
                let cameras = views().map(|view| view.camera).collect();
                edit.ranges.show(value, editor, edit.middle, cameras, ui.ctx());
            }
        }
        let text = "Mean squared error of the base image against the photos, by the blending weight of the Gaussian at each \
                    pixel; colours are from 0 to 1";
        let is_shown = edit.ranges.value == Some(Quantity::Error);
        if has_views && ui.selectable_label(is_shown, "Error").on_hover_text(text).clicked() {
            command = scene.as_ref().and_then(|scene| edit.ranges.show_error(scene)).map(Command::Edit);
        }
    });
    command
}

/// The histogram. A drag over it sets the range.
fn bars(histogram: &Histogram, range: &mut [f32; 2], ui: &mut Ui) {
    let (room, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), HEIGHT), Sense::drag());
    response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, "Histogram"));
    let response = response.on_hover_text("How many Gaussians have which value; drag over a range");
    let share = |x: f32| ((x - room.left()) / room.width().max(1.0)).clamp(0.0, 1.0);
    let origin = ui.input(|input| input.pointer.press_origin());
    if let (true, Some(from), Some(to)) = (response.dragged(), origin, response.interact_pointer_pos()) {
        let [from, to] = [from.x, to.x].map(|x| histogram.value(share(x)));
        *range = [from.min(to), from.max(to)];
    }
    let (visuals, painter) = (ui.visuals(), ui.painter_at(room));
    painter.rect_filled(room, 2.0, visuals.extreme_bg_color);
    let most = histogram.bars.iter().copied().max().unwrap_or(0).max(1) as f32;
    let width = room.width() / histogram.bars.len() as f32;
    let wanted = range.map(|end| histogram.share(end));
    for (number, count) in histogram.bars.iter().enumerate().filter(|(_, count)| **count > 0) {
        let middle = (number as f32 + 0.5) / histogram.bars.len() as f32;
        let half = 0.5 / histogram.bars.len() as f32;
        let is_wanted = middle + half >= wanted[0] && middle - half <= wanted[1];
        let color = if is_wanted { visuals.hyperlink_color } else { visuals.weak_text_color() };
        let left = room.left() + number as f32 * width;
        // By its root, so that rare values are seen beside frequent ones.
        let height = ((*count as f32 / most).sqrt() * (HEIGHT - 2.0)).max(1.0);
        let bar = Rect::from_min_max(pos2(left, room.bottom() - height), pos2(left + width, room.bottom()));
        painter.rect_filled(bar.shrink2(Vec2::new(0.5, 0.0)), 0.0, color);
    }
}

/// What floats apart from the model: selected first, deleted then.
pub fn floaters(edit: &mut Edit, extent: f64, ui: &mut Ui) {
    let Some(floaters) = &mut edit.floaters else { return };
    let gap = Slider::new(&mut floaters.gap, 0.001 * extent..=extent).logarithmic(true).text("gap");
    let gap = ui.add(gap).on_hover_text("In scene units: what lies farther from the rest floats");
    let least = Slider::new(&mut floaters.least, 2..=100_000).logarithmic(true).text("Gaussians");
    let least = ui.add(least).on_hover_text("Groups of at least so many are part of the model");
    let moved = [gap, least].iter().any(|slider| slider.drag_stopped() || slider.lost_focus());
    ui.horizontal_wrapped(|ui| {
        let preview = ui.button("Preview").on_hover_text("Select what floats, to see it before it is deleted");
        if preview.clicked() || moved {
            edit.select_floaters();
        }
        let selects = edit.editor.as_ref().is_some_and(Editor::can_remove);
        if ui.add_enabled(selects, Button::new("Remove selected")).clicked() {
            edit.step(Editor::delete);
        }
    });
}
