//! *Settings*: what is kept for every model.

use super::{floating, scrolled};
use crate::IN_BROWSER;
use crate::keys;
use crate::settings::{ANGLES, Backdrop, SPEEDS, Unit};
use crate::viewer::{Over, Viewer};
use eframe::egui::{ComboBox, Context, DragValue, Grid, Slider, ThemePreference, Ui};

/// The panel, while it is shown.
pub fn settings(viewer: &mut Viewer, ctx: &Context) {
    let mut open = viewer.panels.over == Some(Over::Settings);
    floating("Settings", ctx).open(&mut open).show(ctx, |ui| {
        scrolled(ui, |ui| {
            Grid::new("settings").num_columns(2).spacing([16.0, 8.0]).show(ui, |ui| {
                theme(ui);
                background(viewer, ui);
                angle(viewer, ui);
                speed(viewer, ui);
                switches(viewer, ui);
                if !IN_BROWSER {
                    unit(viewer, ui);
                }
            });
        });
    });
    viewer.panels.put_over(Over::Settings, open);
}

fn theme(ui: &mut Ui) {
    ui.label("Theme");
    let before = ui.ctx().options(|options| options.theme_preference);
    let mut now = before;
    ui.horizontal(|ui| {
        let all =
            [("Dark", ThemePreference::Dark), ("Light", ThemePreference::Light), ("System", ThemePreference::System)];
        for (name, preference) in all {
            ui.selectable_value(&mut now, preference, name);
        }
    });
    if now != before {
        ui.ctx().set_theme(now);
    }
    ui.end_row();
}

fn background(viewer: &mut Viewer, ui: &mut Ui) {
    let settings = &mut viewer.settings;
    let name = ui.label("Background").on_hover_text("What is behind the Gaussians, in the window and in its films");
    ui.horizontal(|ui| {
        let shown = Backdrop::ALL.into_iter().find(|(backdrop, _)| *backdrop == settings.backdrop);
        let chosen = ComboBox::from_id_salt("background").selected_text(shown.map_or("", |(_, name)| name));
        let chosen = chosen.show_ui(ui, |ui| {
            for (backdrop, name) in Backdrop::ALL {
                ui.selectable_value(&mut settings.backdrop, backdrop, name);
            }
        });
        chosen.response.labelled_by(name.id);
        // It keeps its place where it is not needed.
        ui.add_enabled_ui(settings.backdrop == Backdrop::Color, |ui| ui.color_edit_button_srgb(&mut settings.color));
    });
    ui.end_row();
}

fn angle(viewer: &mut Viewer, ui: &mut Ui) {
    let settings = &mut viewer.settings;
    let before = settings.view_angle();
    ui.label("View angle").on_hover_text("Vertical, of a camera that has left a view");
    ui.horizontal(|ui| {
        ui.checkbox(&mut settings.own_angle, "not that of the photo:");
        let value = DragValue::new(&mut settings.angle).range(ANGLES[0]..=ANGLES[1]).speed(0.5).max_decimals(0);
        ui.add_enabled(settings.own_angle, value.suffix("°"));
    });
    ui.end_row();
    let now = settings.view_angle();
    if let Some(now) = now.filter(|_| now != before && viewer.on_view.is_none()) {
        viewer.navigator.fov = now;
        viewer.has_moved();
    }
}

fn speed(viewer: &mut Viewer, ui: &mut Ui) {
    let name = ui.label("Speed of flight").on_hover_text("Of the keys that fly; Shift is four times as fast");
    let range = SPEEDS[0]..=SPEEDS[1];
    let slider = Slider::new(&mut viewer.settings.speed, range).logarithmic(true).max_decimals(1).suffix(" x");
    ui.add(slider).labelled_by(name.id);
    ui.end_row();
}

fn switches(viewer: &mut Viewer, ui: &mut Ui) {
    let settings = &mut viewer.settings;
    ui.label("Picture");
    ui.checkbox(&mut settings.shows_ground, "Grid on the ground").on_hover_text(
        "At the height of the lowest sparse points, across the up axis; its lines are 1, 10 or 0.1 scene units apart, and so on",
    );
    ui.end_row();
    ui.label("");
    ui.checkbox(&mut settings.always_sharp, "Always sharp")
        .on_hover_text("The image of a resting camera has all pixels, also where that takes more than two seconds");
    ui.end_row();
    if !IN_BROWSER {
        ui.label("");
        let mut full = keys::is_full_screen(ui.ctx());
        if ui.checkbox(&mut full, "Full screen (F11)").changed() {
            keys::full_screen(ui.ctx());
        }
        ui.end_row();
    }
}

fn unit(viewer: &mut Viewer, ui: &mut Ui) {
    let unit = &mut viewer.settings.unit;
    let text = "Of the lengths that the editor measures. With a unit, a unit of the saved file is a metre.";
    let name = ui.label("Lengths in").on_hover_text(text);
    let chosen = ComboBox::from_id_salt("unit").selected_text(unit.name()).show_ui(ui, |ui| {
        for other in Unit::ALL {
            ui.selectable_value(unit, other, other.name());
        }
    });
    chosen.response.labelled_by(name.id).on_hover_text(text);
    ui.end_row();
}
