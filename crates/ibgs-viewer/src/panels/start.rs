//! The start page, and opening things.

use super::elided;
use crate::OpenRequest;
use crate::dialogs::{Answer, Sought};
use crate::photos_form;
use crate::recents::Recent;
use crate::thumbnails::paint;
use crate::train_form::Asked;
use crate::viewer::Viewer;
use eframe::egui::{self, Align2, Image, Key, Rect, Sense, Stroke, TextEdit, TextStyle, Ui, UiBuilder, Vec2};

/// Windows of this width in points have the form beside the rest.
const WIDE: f32 = 900.0;
/// Width of the form, and of all else, in points.
const FORM: f32 = 400.0;
const REST: f32 = 640.0;
/// Size of a model that was opened before, and of its picture.
const TILE: Vec2 = Vec2::new(128.0, 110.0);
const TILE_PICTURE: Vec2 = Vec2::new(120.0, 80.0);

const STEPS: [(&str, &str); 3] = [
    (
        "1. Photos to poses",
        "Drop a folder of photos or a video into this window, or choose it in the form. COLMAP finds out where each photo was \
         taken, and a scene folder is made. `ibgs prepare` does the same in a terminal.",
    ),
    ("2. Train", "Choose the scene folder and press Train. You can watch, pause and save the training in this window."),
    (
        "3. Look, edit, export",
        "Move through the model, delete what should not be in it, render films, share it. `ibgs export` and `ibgs mesh` \
         write more formats.",
    ),
];

/// Takes what was chosen in a file dialog.
pub fn chosen(viewer: &mut Viewer) {
    match viewer.start.dialog.answer() {
        Some(Answer::Chosen(Sought::Scene, path)) => viewer.start.ask_about(path),
        Some(Answer::Chosen(Sought::Photos | Sought::Video, path)) => viewer.start.ask_about_photos(path),
        Some(Answer::Chosen(Sought::ModelFolder | Sought::ModelFile, path)) => viewer.open(OpenRequest::Path(path)),
        Some(Answer::NoDialog) => {
            viewer.error = Some("no file dialog here; type the path".to_owned());
            viewer.start.show();
            viewer.start.finds_address = true;
        }
        None => {}
    }
}

/// Buttons that open file dialogs.
fn dialogs(viewer: &mut Viewer, ui: &mut Ui) {
    let dialog = &mut viewer.start.dialog;
    ui.add_enabled_ui(!dialog.is_open(), |ui| {
        ui.menu_button("Open a model...", |ui| {
            for (name, sought) in [("Model folder", Sought::ModelFolder), ("Bundle or file", Sought::ModelFile)] {
                if ui.button(name).clicked() {
                    dialog.open(sought, ui.ctx());
                    ui.close();
                }
            }
        });
        if ui.button("Train on a scene...").clicked() {
            dialog.open(Sought::Scene, ui.ctx());
            ui.close();
        }
    });
}

/// The same as a menu.
pub fn menu(viewer: &mut Viewer, ui: &mut Ui) {
    if ui.add_enabled(!viewer.start.shown, egui::Button::new("Start page")).clicked() {
        viewer.start.show();
        ui.close();
    }
    dialogs(viewer, ui);
    let recent = viewer.settings.recent.clone();
    if !recent.is_empty() {
        ui.separator();
        ui.weak("Opened before");
        for path in recent {
            if ui.button(path.display().to_string()).clicked() {
                viewer.open(OpenRequest::Path(path));
                ui.close();
            }
        }
    }
}

/// A field for a path.
fn address(viewer: &mut Viewer, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let label = ui.label("Path").id;
        let address = &mut viewer.start.address;
        let width = (ui.available_width() - 60.0).clamp(60.0, 300.0);
        let field = TextEdit::singleline(&mut address.text).hint_text("folder or file").desired_width(width);
        let field = ui.add(field).labelled_by(label).on_hover_text(
            "A model folder, an .ibgs bundle or a PLY file to look at; a scene folder (COLMAP or transforms.json) to train on; photos or a video to find poses of",
        );
        if std::mem::take(&mut viewer.start.finds_address) {
            field.request_focus();
            field.scroll_to_me(None);
        }
        let entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
        let path = address.path();
        let clicked = ui.add_enabled(path.is_some(), egui::Button::new("Open")).clicked();
        if let Some(path) = path.filter(|_| entered || clicked) {
            viewer.open(OpenRequest::Path(path));
        }
    });
}

/// What was opened before, as a row of pictures.
fn recents(viewer: &mut Viewer, ui: &mut Ui) {
    let recents = viewer.start.recents.of(&viewer.settings.recent, ui.ctx());
    if recents.is_empty() {
        return;
    }
    ui.strong("Opened before");
    let mut wanted = None;
    ui.horizontal_wrapped(|ui| {
        for recent in recents {
            if tile(ui, recent) {
                wanted = Some(recent.path.clone());
            }
        }
    });
    if let Some(path) = wanted {
        viewer.open(OpenRequest::Path(path));
    }
}

/// One of them; true when it was clicked.
fn tile(ui: &mut Ui, recent: &Recent) -> bool {
    let sense = if recent.is_missing { Sense::hover() } else { Sense::click() };
    let (rect, response) = ui.allocate_exact_size(TILE, sense);
    let name = recent.path.file_name().unwrap_or(recent.path.as_os_str()).to_string_lossy();
    let enabled = ui.is_enabled() && !recent.is_missing;
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, enabled, &*name));
    let (visuals, painter) = (ui.visuals(), ui.painter_at(rect));
    if enabled && (response.hovered() || response.has_focus()) {
        painter.rect_filled(rect, 4.0, visuals.widgets.hovered.bg_fill);
    }
    let room = Rect::from_min_size(rect.min + Vec2::splat(4.0), TILE_PICTURE);
    painter.rect(room, 3.0, visuals.extreme_bg_color, Stroke::NONE, egui::StrokeKind::Inside);
    let text = if enabled { visuals.text_color() } else { visuals.weak_text_color() };
    let small = TextStyle::Small.resolve(ui.style());
    match &recent.picture {
        Some(picture) => paint(&painter, picture, room),
        None => {
            let kind = recent.path.extension().map(|extension| extension.to_string_lossy().to_uppercase());
            let kind = if recent.is_missing { "not found".to_owned() } else { kind.unwrap_or_default() };
            painter.text(room.center(), Align2::CENTER_CENTER, kind, small, visuals.weak_text_color());
        }
    }
    let galley = elided(ui, &name, TextStyle::Small, text, TILE_PICTURE.x);
    painter.galley(egui::pos2(room.left(), room.bottom() + 4.0), galley, text);
    let path = recent.path.display();
    let (hover, clicked) =
        (if recent.is_missing { format!("{path} is not there") } else { path.to_string() }, response.clicked());
    response.on_hover_text(hover);
    clicked
}

/// A text with commands between backticks.
fn with_commands(ui: &mut Ui, text: &str) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 0.0;
        for (index, part) in text.split('`').enumerate() {
            let _ = if index % 2 == 1 { ui.code(part) } else { ui.label(part) };
        }
    });
}

/// Picture, steps, buttons and what was opened before.
fn welcome(viewer: &mut Viewer, ui: &mut Ui) {
    let width = ui.available_width();
    if let Some(picture) = viewer.start.picture(ui.ctx()) {
        // In a low window a strip of it leaves room for the rest.
        let height = (width * 0.375).min(0.3 * ui.ctx().content_rect().height());
        let share = height / (width * 0.375);
        let strip = Rect::from_min_max(egui::pos2(0.0, 0.5 - 0.5 * share), egui::pos2(1.0, 0.5 + 0.5 * share));
        ui.add(
            Image::new(picture)
                .maintain_aspect_ratio(false)
                .uv(strip)
                .fit_to_exact_size(Vec2::new(width, height))
                .corner_radius(6)
                .alt_text("The demo scene"),
        );
    }
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        ui.heading("Photos in, a scene to walk through out");
        if viewer.scene.is_some() && ui.button("Back").on_hover_text("Back to what is open").clicked() {
            viewer.start.shown = false;
        }
    });
    for (name, text) in STEPS {
        ui.strong(name);
        with_commands(ui, text);
    }
    ui.add_space(8.0);
    ui.horizontal_wrapped(|ui| dialogs(viewer, ui));
    address(viewer, ui);
    ui.weak("Or drop a model folder, an .ibgs bundle, a PLY file, a scene folder, photos or a video into this window.");
    ui.add_space(8.0);
    recents(viewer, ui);
}

/// The form for photos, and how far their preparation is.
fn photos(viewer: &mut Viewer, ui: &mut Ui) {
    let shown = ui.group(|ui| {
        ui.set_min_width(ui.available_width());
        ui.heading("Find poses of photos");
        let start = &mut viewer.start;
        start.photos.show(&start.preparing, ui)
    });
    if std::mem::take(&mut viewer.start.finds_photos) {
        shown.response.scroll_to_me(None);
    }
    match shown.inner {
        Some(photos_form::Asked::BrowsePhotos) => viewer.start.dialog.open(Sought::Photos, ui.ctx()),
        Some(photos_form::Asked::BrowseVideo) => viewer.start.dialog.open(Sought::Video, ui.ctx()),
        Some(photos_form::Asked::Prepare(wanted)) => viewer.prepare(wanted),
        Some(photos_form::Asked::Stop) => viewer.stop_preparing(),
        None => {}
    }
}

/// Both forms.
fn forms(viewer: &mut Viewer, ui: &mut Ui) {
    photos(viewer, ui);
    ui.add_space(8.0);
    form(viewer, ui);
}

fn form(viewer: &mut Viewer, ui: &mut Ui) {
    let form = ui.group(|ui| {
        ui.set_min_width(ui.available_width());
        ui.heading("Train on a scene");
        viewer.start.form.show(ui)
    });
    if std::mem::take(&mut viewer.start.finds_form) {
        form.response.scroll_to_me(None);
    }
    match form.inner {
        Some(Asked::Browse) => viewer.start.dialog.open(Sought::Scene, ui.ctx()),
        Some(Asked::Open(wanted)) => viewer.open(wanted),
        None => {}
    }
}

/// The page.
pub fn start(viewer: &mut Viewer, ui: &mut Ui) {
    // What a training says of itself, such as that it saves, hinders nothing here.
    if viewer.opening {
        ui.disable();
    }
    egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        let room = ui.available_rect_before_wrap();
        let is_wide = room.width() >= WIDE;
        let gap = 24.0;
        let rest = REST.min(if is_wide { room.width() - FORM - gap } else { room.width() });
        let all = if is_wide { rest + gap + FORM } else { rest };
        let left = room.left() + (0.5 * (room.width() - all)).max(0.0);
        let column = |x: f32, width: f32| {
            let rect = Rect::from_min_size(egui::pos2(left + x, room.top()), Vec2::new(width, f32::INFINITY));
            UiBuilder::new().max_rect(rect)
        };
        ui.scope_builder(column(0.0, rest), |ui| {
            welcome(viewer, ui);
            if !is_wide {
                ui.add_space(8.0);
                forms(viewer, ui);
            }
        });
        if is_wide {
            ui.scope_builder(column(rest + gap, FORM), |ui| forms(viewer, ui));
        }
    });
}
