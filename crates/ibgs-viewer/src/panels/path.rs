//! The camera path's panel: duration, files, films and stills. Its keyframes are in the timeline.

use crate::View;
use crate::film::{Film, FilmQuality, FilmTarget};
use crate::mode::Mode;
use crate::navigator::Navigator;
use crate::path_editor::PathEditor;
use crate::viewer::Viewer;
use crate::worker::Command;
use eframe::egui::{self, ComboBox, DragValue, ProgressBar, TextEdit, Ui};
use ibgs_core::camera_path::{CameraPathError, KeyframePath};
use std::path::{Path, PathBuf};

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
    ui.horizontal_wrapped(|ui| frame_size(&mut viewer.panels.path, ui));
    ui.horizontal_wrapped(|ui| look(viewer, ui));
    film(viewer, ui);
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
    if ui.checkbox(&mut cycle, "round").on_hover_text("Back to the first keyframe at the end").changed() {
        editor.set_cycle(cycle);
    }
    ui.add_enabled(!cycle, egui::Checkbox::new(&mut editor.path.eased, "ease")).on_hover_text("Begin and end at rest");
}

fn frame_size(editor: &mut PathEditor, ui: &mut Ui) {
    ui.add(DragValue::new(&mut editor.path.width).range(16..=8192).clamp_existing_to_range(false));
    ui.label("x");
    ui.add(DragValue::new(&mut editor.path.height).range(16..=8192).clamp_existing_to_range(false));
    ui.label("pixels").on_hover_text("Size of the frames");
    ui.add(DragValue::new(&mut editor.path.fps).range(1.0..=240.0).clamp_existing_to_range(false).suffix(" FPS"))
        .on_hover_text("Frames a second");
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
            format!("{} keyframes from {}", editor.keyframes(), file.display())
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
    ComboBox::from_id_salt("film mode").selected_text(name).show_ui(ui, |ui| {
        ui.selectable_value(&mut editor.mode, None, "as shown");
        for mode in offered {
            ui.selectable_value(&mut editor.mode, Some(mode), mode.name());
        }
    });
    ComboBox::from_id_salt("film quality").selected_text(editor.quality.name()).show_ui(ui, |ui| {
        for quality in FilmQuality::ALL {
            ui.selectable_value(&mut editor.quality, quality, quality.name());
        }
    });
}

/// A name that is free.
fn free(folder: &Path, name: impl Fn(u32) -> String) -> Option<PathBuf> {
    (1..).map(|n| folder.join(name(n))).find(|path| !path.exists())
}

/// The film of the path, or a picture from where the camera is, under a name that is free.
fn film_of(viewer: &Viewer, is_still: bool) -> Option<Film> {
    let pictures = &viewer.scene.as_ref()?.pictures;
    let editor = &viewer.panels.path;
    let (path, style) = (&editor.path, viewer.canvas.style);
    let target = match is_still {
        true => FilmTarget::Still(free(pictures, |n| format!("still-{n}.png"))?),
        false => FilmTarget::Frames(free(pictures, |n| format!("film-{n}"))?),
    };
    let cameras = match is_still {
        true => vec![viewer.navigator.keyframe().camera(path.width, path.height)],
        false => path.frames(),
    };
    let mode = editor.mode.unwrap_or(viewer.mode);
    Some(Film { cameras, fps: path.fps, mode, style, quality: editor.quality, target })
}

/// The buttons, or how far the film is.
fn film(viewer: &mut Viewer, ui: &mut Ui) {
    if let Some((done, count)) = viewer.panels.path.filming {
        ui.add(ProgressBar::new(done as f32 / count.max(1) as f32).text(format!("{done} of {count}")));
        if ui.button("Cancel").clicked() {
            viewer.send(Command::CancelFilm);
        }
        return;
    }
    let ready = viewer.panels.path.keyframes() > 0;
    let asked = ui.horizontal_wrapped(|ui| {
        let film = ui.add_enabled(ready, egui::Button::new("Render film"));
        let film =
            film.on_hover_text("Write every frame as PNG, and a video where ffmpeg is on this machine").clicked();
        let still =
            ui.button("Render still").on_hover_text("Write a PNG of this size from where the camera is").clicked();
        (film || still).then_some(still)
    });
    if let Some(film) = asked.inner.and_then(|is_still| film_of(viewer, is_still)) {
        viewer.panels.path.filming = Some((0, film.cameras.len()));
        viewer.send(Command::Film(Box::new(film)));
    }
}
