//! The bar along the top, and the line below it that says what is done and what went wrong.

use crate::IN_BROWSER;
use crate::icons::{self, icon};
use crate::mode::Mode;
use crate::panels::sides::SMALL;
use crate::panels::start;
use crate::viewer::{Over, Viewer};
use eframe::egui::containers::menu::MenuButton;
use eframe::egui::{self, Align2, Area, Button, Context, DragValue, Frame, Id, Ui, Vec2};
use glam::DVec3;
use std::time::Duration;
use web_time::Instant;

/// Modes that have buttons of their own in windows of at least this width, in points.
const BUTTONS: [(f32, usize); 2] = [(SMALL, 3), (1150.0, 5)];
/// Width of the menu of the others in points, which has room for every name.
const MENU: f32 = 128.0;
/// How long a message of success is shown.
const READ: Duration = Duration::from_secs(8);

/// Menus, modes and camera along the top.
pub fn bar(viewer: &mut Viewer, ui: &mut Ui) {
    egui::Panel::top("bar").show(ui, |ui| {
        ui.horizontal_wrapped(|ui| {
            ui.style_mut().wrap_mode = Some(egui::TextWrapMode::Extend);
            let is_small = ui.ctx().content_rect().width() < SMALL;
            if is_small {
                ui.spacing_mut().item_spacing.x = 4.0;
            }
            let separator = |ui: &mut Ui| _ = (!is_small).then(|| ui.separator());
            if !IN_BROWSER {
                ui.menu_button((icon(icons::FOLDER), "Scene"), |ui| {
                    start::menu(viewer, ui);
                    if let Some(scene) = &viewer.scene {
                        ui.separator();
                        ui.weak(&scene.title);
                    }
                });
            }
            let looks = viewer.scene.is_some() && !viewer.start.shown;
            if looks {
                show(viewer, ui);
                camera(viewer, ui);
                if !IN_BROWSER {
                    edit(viewer, ui);
                    film(viewer, ui);
                    share(viewer, ui);
                }
                separator(ui);
                modes(viewer, ui);
                split(viewer, ui);
                separator(ui);
            }
            let shown = viewer.panels.over == Some(Over::Settings);
            if ui.selectable_label(shown, "Settings").on_hover_text("What is kept for every model").clicked() {
                viewer.panels.put_over(Over::Settings, !shown);
            }
            if looks && ui.button("?").on_hover_text("Keys and pointer. Key F1.").clicked() {
                viewer.panels.put_over(Over::Help, viewer.panels.over != Some(Over::Help));
            }
        });
    });
}

fn show(viewer: &mut Viewer, ui: &mut Ui) {
    ui.menu_button((icon(icons::EYE), "Show"), |ui| {
        let panels = &mut viewer.panels;
        ui.checkbox(&mut panels.shows_cameras, "Cameras (C)").on_hover_text(
            "Where the photos were taken: trained on in blue, held out in orange, sources of the clicked pixel in green",
        );
        ui.checkbox(&mut panels.shows_points, "Sparse points")
            .on_hover_text("Points of the scene that the training began with");
        let mut figures = !panels.hides_figures;
        ui.checkbox(&mut figures, "Figures").on_hover_text("Size, time and memory of the image");
        panels.hides_figures = !figures;
        if IN_BROWSER {
            return;
        }
        ui.separator();
        if ui.button("Screenshot (P)").on_hover_text("Write what the canvas shows as a PNG file").clicked() {
            viewer.screenshot();
            ui.close();
        }
    });
}

/// The button of the editor.
fn edit(viewer: &mut Viewer, ui: &mut Ui) {
    let button =
        ui.add_enabled(viewer.training.is_none(), Button::selectable(viewer.edit.shown, (icon(icons::PENCIL), "Edit")));
    let text = "Select Gaussians, hide and delete them, save the model. Key X.";
    if button.on_hover_text(text).on_disabled_hover_text("A model in training cannot be edited").clicked() {
        viewer.show_editor(!viewer.edit.shown);
    }
}

/// The button of films and stills.
fn film(viewer: &mut Viewer, ui: &mut Ui) {
    let shown = viewer.panels.shows_path;
    let button = ui.add(Button::selectable(shown, (icon(icons::FILM), "Film")));
    if button.on_hover_text("A camera path through keyframes, films of it, and still pictures of any size").clicked() {
        viewer.show_path(!shown);
    }
}

/// The button of what is written for others.
fn share(viewer: &mut Viewer, ui: &mut Ui) {
    let model = viewer.shared_model();
    let shown = viewer.panels.over == Some(Over::Share);
    let button = ui.add_enabled(model.is_some(), Button::selectable(shown, (icon(icons::SHARE), "Share")));
    let text = "Write a page for browsers, a bundle, or Gaussians for other programs";
    if button.on_hover_text(text).on_disabled_hover_text("Once the training has ended").clicked() {
        viewer.panels.put_over(Over::Share, !shown);
    }
}

/// The modes: the usual ones as buttons, all others in a menu; in a small window every mode is in the menu, which bears the
/// name of the one that is shown.
fn modes(viewer: &mut Viewer, ui: &mut Ui) {
    let width = ui.ctx().content_rect().width();
    let buttons = BUTTONS.iter().rev().find(|(least, _)| width >= *least).map_or(0, |(_, buttons)| *buttons);
    let (usual, others) = Mode::ALL.split_at(buttons);
    for &mode in usual {
        if mode_button(viewer, ui, viewer.mode, mode) {
            viewer.show_mode(mode);
        }
    }
    let is_other = others.contains(&viewer.mode);
    let name = if is_other { viewer.mode.name() } else { "More" };
    // As wide for every mode, so that the bar keeps its height.
    let button = Button::selectable(is_other, (name, icon(icons::DOWN))).min_size(Vec2::new(MENU, 0.0));
    let menu = MenuButton::from_button(button);
    let (response, _) = menu.ui(ui, |ui| {
        for &mode in others {
            if mode_button(viewer, ui, viewer.mode, mode) {
                viewer.show_mode(mode);
                ui.close();
            }
        }
    });
    response.on_hover_text("What the picture shows");
}

/// A button of a mode; whether it was clicked.
fn mode_button(viewer: &Viewer, ui: &mut Ui, shown: impl Into<Option<Mode>>, mode: Mode) -> bool {
    let key = mode.key().map_or(String::new(), |key| format!(" Key {}.", key.name()));
    let text = format!("{}.{key}", mode.meaning());
    let button = ui.add_enabled(viewer.offers(mode), Button::selectable(shown.into() == Some(mode), mode.name()));
    let why_not = viewer.lacks(mode).unwrap_or_default();
    button.on_hover_text(&text).on_disabled_hover_text(format!("{why_not}. {text}")).clicked()
}

fn split(viewer: &mut Viewer, ui: &mut Ui) {
    let menu = MenuButton::from_button(Button::selectable(viewer.other.is_some(), ("Split", icon(icons::DOWN))));
    let (response, _) = menu.ui(ui, |ui| {
        if ui.selectable_label(viewer.other.is_none(), "No split").clicked() {
            viewer.show_other(None);
            ui.close();
        }
        let shown = viewer.mode;
        for mode in Mode::ALL.into_iter().filter(|mode| *mode != shown) {
            if mode_button(viewer, ui, viewer.other, mode) {
                viewer.show_other(Some(mode));
                ui.close();
            }
        }
    });
    response.on_hover_text("Show another mode right of a line that you can drag");
}

fn camera(viewer: &mut Viewer, ui: &mut Ui) {
    ui.menu_button((icon(icons::CAMERA), "Camera"), |ui| {
        ui.horizontal(|ui| {
            let mut degrees = viewer.navigator.fov.to_degrees();
            // Only what the user does may change it: a view's own angle is neither round nor always in the range.
            let angle = DragValue::new(&mut degrees).range(10.0..=120.0).clamp_existing_to_range(false).speed(0.5);
            let name = ui.label("View angle");
            let angle = ui.add(angle.fixed_decimals(0).suffix("°")).labelled_by(name.id);
            if angle.on_hover_text("Vertical field of view; drag or click to change it").changed() {
                viewer.has_moved();
                viewer.navigator.fov = degrees.to_radians();
            }
        });
        ui.menu_button("Up axis", |ui| up_axes(viewer, ui)).response.on_hover_text("The axis that orbits go around");
        ui.checkbox(&mut viewer.panels.only_frame, "Nothing beyond the photo")
            .on_hover_text("A view's own picture alone, without what lies around it");
        ui.separator();
        if ui.button("Reset").on_hover_text("Back to the first view. Key R.").clicked() {
            viewer.reset();
            ui.close();
        }
    });
}

fn up_axes(viewer: &mut Viewer, ui: &mut Ui) {
    let axes = [("X", DVec3::X), ("Y", DVec3::Y), ("Z", DVec3::Z)];
    let signed = axes.into_iter().flat_map(|(name, axis)| [(format!("+{name}"), axis), (format!("-{name}"), -axis)]);
    for (name, up) in std::iter::once(("As in the photos".to_owned(), viewer.photos_up)).chain(signed) {
        if ui.selectable_label(viewer.navigator.up == up, name).clicked() {
            viewer.navigator.up = up;
            ui.close();
        }
    }
}

/// Takes away what was done once it has been read; what went wrong stays until it is closed.
fn fade(viewer: &mut Viewer, ctx: &Context) {
    let Some(message) = &viewer.message else {
        viewer.said = None;
        return;
    };
    match &viewer.said {
        Some((said, at)) if said == message => match READ.checked_sub(at.elapsed()) {
            Some(rest) => ctx.request_repaint_after(rest),
            None => viewer.message = None,
        },
        _ => {
            viewer.said = Some((message.clone(), Instant::now()));
            ctx.request_repaint_after(READ);
        }
    }
}

/// What is being done, was done, or went wrong: over the lower edge of the picture, which keeps its size.
pub fn status(viewer: &mut Viewer, ctx: &Context) {
    fade(viewer, ctx);
    // The question about unsaved edits says itself what went wrong.
    let asks = viewer.leaving.is_some();
    if viewer.doing.is_none() && (viewer.error.is_none() || asks) && viewer.message.is_none() {
        return;
    }
    // What is around the picture can still be clicked.
    let room = viewer.panels.picture.unwrap_or(ctx.content_rect());
    let most = (room.width() - 48.0).clamp(160.0, 900.0);
    let at = room.center_bottom() - Vec2::new(0.0, 16.0);
    Area::new(Id::unique("status")).fixed_pos(at).pivot(Align2::CENTER_BOTTOM).show(ctx, |ui| {
        Frame::popup(ui.style()).show(ui, |ui| {
            ui.set_max_width(most);
            if let Some(doing) = &viewer.doing {
                ui.horizontal(|ui| {
                    ui.spinner();
                    ui.label(doing);
                });
            }
            let color = ui.visuals().error_fg_color;
            for (line, color) in [(&mut viewer.error, Some(color)), (&mut viewer.message, None)] {
                let Some(text) = line.clone().filter(|_| color.is_none() || !asks) else { continue };
                ui.horizontal_wrapped(|ui| {
                    match color {
                        Some(color) => ui.colored_label(color, text),
                        None => ui.label(text),
                    };
                    if ui.small_button("Close").clicked() {
                        *line = None;
                    }
                });
            }
        });
    });
}
