//! The camera path's panel: duration, files, films and stills. Its keyframes are in the timeline.

use crate::View;
use crate::film::FilmQuality;
use crate::mode::Mode;
use crate::navigator::Navigator;
use crate::path_editor::PathEditor;
use crate::viewer::Viewer;
use crate::worker::Command;
use eframe::egui::{self, ComboBox, DragValue, Grid, TextEdit, Ui};
use ibgs_core::camera_path::{CameraPathError, KeyframePath};
use ibgs_core::counted;
use std::path::PathBuf;

/// The panel at the right.
pub fn panel(viewer: &mut Viewer, ui: &mut Ui) {
    let navigator = viewer.navigator;
    let views: &[View] = viewer.scene.as_ref().map_or(&[], |scene| &scene.views);
    let editor = &mut viewer.panels.path;
    ui.heading("Camera path");
    ui.horizontal_wrapped(|ui| buttons(editor, &navigator, views, ui));
    ui.horizontal_wrapped(|ui| timing(editor, ui));
    match ui.horizontal_wrapped(|ui| file(editor, ui)).inner {
        Some(Ok(message)) => viewer.message = Some(message),
        Some(Err(error)) => viewer.error = Some(error.to_string()),
        None => {}
    }
    ui.separator();
    ui.heading("Film and still");
    film(viewer, ui);
    Grid::new("film").num_columns(2).show(ui, |ui| {
        frame_size(&mut viewer.panels.path, ui);
        look(viewer, ui);
    });
    ui.separator();
}

/// What is done with the path as a whole.
fn buttons(editor: &mut PathEditor, navigator: &Navigator, views: &[View], ui: &mut Ui) {
    if ui.button("Add keyframe").on_hover_text("Where the camera is now. Key K.").clicked() {
        editor.add(navigator);
    }
    let text =
        "Replace the path by a turn around what the camera orbits, at its height and on the sides that photos show";
    if ui.button("Turntable").on_hover_text(text).clicked() {
        editor.turn(navigator, views);
    }
    if ui.add_enabled(editor.keyframes() > 0, egui::Button::new("Clear")).clicked() {
        editor.clear();
    }
}

/// Duration, and how the path begins and ends.
fn timing(editor: &mut PathEditor, ui: &mut Ui) {
    let duration = DragValue::new(&mut editor.path.seconds)
        .range(0.1..=3600.0)
        .clamp_existing_to_range(false)
        .speed(0.1)
        .prefix("lasts ")
        .suffix(" s");
    ui.add(duration).on_hover_text("Whole duration; all ways take part in it");
    let mut cycle = editor.path.cycle;
    if ui.checkbox(&mut cycle, "closed loop").on_hover_text("Back to the first keyframe at the end").changed() {
        editor.set_cycle(cycle);
    }
    ui.add_enabled(!cycle, egui::Checkbox::new(&mut editor.path.eased, "ease in and out"))
        .on_hover_text("Begin and end at rest");
}

fn frame_size(editor: &mut PathEditor, ui: &mut Ui) {
    ui.label("size").on_hover_text("Width and height of the frames in pixels");
    ui.horizontal(|ui| {
        ui.add(DragValue::new(&mut editor.path.width).range(16..=8192).clamp_existing_to_range(false));
        ui.label("x");
        ui.add(DragValue::new(&mut editor.path.height).range(16..=8192).clamp_existing_to_range(false));
    });
    ui.end_row();
    ui.label("speed").on_hover_text("Frames a second");
    ui.add(DragValue::new(&mut editor.path.fps).range(1.0..=240.0).clamp_existing_to_range(false).suffix(" FPS"));
    ui.end_row();
}

/// Saves and loads the path; returns what to tell the user of it.
fn file(editor: &mut PathEditor, ui: &mut Ui) -> Option<Result<String, CameraPathError>> {
    let field = TextEdit::singleline(&mut editor.file).desired_width(150.0);
    ui.add(field).on_hover_text("A camera path as nerfstudio writes and reads it");
    let file = PathBuf::from(editor.file.trim());
    let mut result = None;
    if ui.add_enabled(editor.keyframes() > 0, egui::Button::new("Save")).clicked() {
        result = Some(editor.path.save(&file).map(|()| format!("camera path: {}", file.display())));
    }
    if ui.button("Load").clicked() {
        let loaded = KeyframePath::load(&file);
        result = Some(loaded.map(|path| {
            editor.load(path);
            format!("{} from {}", counted(editor.keyframes(), "keyframe"), file.display())
        }));
    }
    result
}

/// What is shown, and how much the video is compressed.
fn look(viewer: &mut Viewer, ui: &mut Ui) {
    let offered: Vec<Mode> = Mode::ALL.into_iter().filter(|mode| !mode.needs_photo() && viewer.offers(*mode)).collect();
    let editor = &mut viewer.panels.path;
    editor.mode = editor.mode.filter(|mode| offered.contains(mode));
    let name = editor.mode.map_or("as shown", Mode::name);
    ui.label("shows");
    ComboBox::from_id_salt("film mode").selected_text(name).show_ui(ui, |ui| {
        ui.selectable_value(&mut editor.mode, None, "as shown");
        for mode in offered {
            ui.selectable_value(&mut editor.mode, Some(mode), mode.name());
        }
    });
    ui.end_row();
    ui.label("video").on_hover_text("How much the video is compressed; the frames beside it are not");
    ComboBox::from_id_salt("film quality").selected_text(editor.quality.name()).show_ui(ui, |ui| {
        for quality in FilmQuality::ALL {
            ui.selectable_value(&mut editor.quality, quality, quality.name());
        }
    });
    ui.end_row();
}

/// The buttons, or how far the film is.
fn film(viewer: &mut Viewer, ui: &mut Ui) {
    let editor = &viewer.panels.path;
    if let Some(bar) = &editor.filming {
        let cancel = ui.horizontal(|ui| {
            ui.add(bar.widget().desired_width((ui.available_width() - 70.0).max(80.0)));
            ui.button("Cancel").on_hover_text("What is rendered stays").clicked()
        });
        if cancel.inner {
            viewer.send(Command::CancelFilm);
        }
        return;
    }
    let ready = editor.keyframes() > 0;
    let asked = ui.horizontal_wrapped(|ui| {
        let film = ui.add_enabled(ready, egui::Button::new("Render film"));
        let film = film
            .on_hover_text("Write every frame as PNG, and a video where ffmpeg is on this machine")
            .on_disabled_hover_text("Add keyframes first, by key K");
        let still = ui.button("Render still").on_hover_text("Write a PNG of this size from where the camera is");
        [film.clicked(), still.clicked()]
    });
    if let Some(written) = &editor.written {
        ui.label(written);
    }
    if let Some(is_still) = asked.inner.iter().position(|asked| *asked) {
        viewer.film(is_still == 1);
    }
}
