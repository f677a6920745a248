//! The camera path's panel: keyframes, preview, files, film.

use crate::View;
use crate::film::Film;
use crate::navigator::Navigator;
use crate::path_editor::PathEditor;
use crate::viewer::Viewer;
use crate::worker::Command;
use eframe::egui::{self, DragValue, ProgressBar, Slider, TextEdit, Ui};
use ibgs_core::camera_path::{CameraPathError, KeyframePath};
use std::path::PathBuf;

/// Height of the list of keyframes in points; a longer list scrolls.
const KEYFRAMES_HEIGHT: f32 = 150.0;

/// The panel at the right.
pub fn panel(viewer: &mut Viewer, ui: &mut Ui) {
    let navigator = viewer.navigator;
    let views: &[View] = viewer.scene.as_ref().map_or(&[], |scene| &scene.views);
    let editor = &mut viewer.panels.path;
    ui.heading("Camera path");
    ui.horizontal_wrapped(|ui| buttons(editor, &navigator, views, ui));
    // Those of a turn are many: the film's button has to stay in sight.
    egui::ScrollArea::vertical()
        .id_salt("keyframes")
        .max_height(KEYFRAMES_HEIGHT)
        .auto_shrink([false, true])
        .show(ui, |ui| keyframes(editor, &navigator, ui));
    let (seconds, any) = (editor.path.seconds, editor.keyframes() > 0);
    let slider = Slider::new(&mut editor.at, 0.0..=seconds).suffix(" s").fixed_decimals(2);
    if ui.add_enabled(any, slider).on_hover_text("Move along the path").changed() {
        (editor.moved, editor.playing) = (true, false);
    }
    ui.horizontal_wrapped(|ui| timing(editor, ui));
    ui.horizontal_wrapped(|ui| frame_size(editor, ui));
    match ui.horizontal_wrapped(|ui| file(editor, ui)).inner {
        Some(Ok(message)) => viewer.message = Some(message),
        Some(Err(error)) => viewer.error = Some(error.to_string()),
        None => {}
    }
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
    let name = if editor.playing { "Stop" } else { "Play" };
    let play = ui.add_enabled(editor.keyframes() > 1, egui::Button::new(name));
    if play.on_hover_text("Key Space").clicked() {
        editor.toggle();
    }
    if ui.add_enabled(editor.keyframes() > 0, egui::Button::new("Clear")).clicked() {
        *editor = PathEditor { file: std::mem::take(&mut editor.file), ..PathEditor::default() };
    }
}

fn keyframes(editor: &mut PathEditor, navigator: &Navigator, ui: &mut Ui) {
    let (mut removed, mut shown) = (None, None);
    for index in 0..editor.keyframes() {
        let time = editor.path.time_of(index);
        ui.horizontal(|ui| {
            if ui.button(format!("{}", index + 1)).on_hover_text("Go there").clicked() {
                shown = Some(time);
            }
            ui.label(format!("{time:.1} s"));
            if ui.small_button("Set").on_hover_text("Move it to where the camera is now").clicked() {
                editor.path.keyframes[index] = navigator.keyframe();
            }
            if ui.small_button("Remove").clicked() {
                removed = Some(index);
            }
        });
    }
    if let Some(time) = shown {
        (editor.at, editor.moved, editor.playing) = (time, true, false);
    }
    if let Some(index) = removed {
        editor.path.keyframes.remove(index);
        editor.retime();
        editor.playing &= editor.keyframes() > 1;
    }
}

/// Duration, frame rate, and whether the path is closed.
fn timing(editor: &mut PathEditor, ui: &mut Ui) {
    let duration = DragValue::new(&mut editor.path.seconds).range(0.1..=3600.0).speed(0.1).suffix(" s");
    editor.timed |= ui.add(duration).on_hover_text("Whole duration").changed();
    ui.add(DragValue::new(&mut editor.path.fps).range(1.0..=240.0).suffix(" FPS")).on_hover_text("Frames a second");
    if ui.checkbox(&mut editor.path.cycle, "round").on_hover_text("Back to the first keyframe at the end").changed() {
        editor.retime();
    }
}

fn frame_size(editor: &mut PathEditor, ui: &mut Ui) {
    ui.add(DragValue::new(&mut editor.path.width).range(16..=8192));
    ui.label("x");
    ui.add(DragValue::new(&mut editor.path.height).range(16..=8192));
    ui.label("pixels").on_hover_text("Size of the film's frames");
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
            (editor.path, editor.timed, editor.at, editor.moved) = (path, true, 0.0, true);
            format!("{} keyframes from {}", editor.keyframes(), file.display())
        }));
    }
    result
}

/// The film of the path, in a folder that is free.
fn film_of(viewer: &Viewer) -> Option<Film> {
    let pictures = &viewer.scene.as_ref()?.pictures;
    let folder = (1..).map(|n| pictures.join(format!("film-{n}"))).find(|folder| !folder.exists())?;
    let path = &viewer.panels.path.path;
    let style = viewer.canvas.style;
    Some(Film { cameras: path.frames(), fps: path.fps, mode: viewer.mode, style, folder })
}

/// The film's button, or how far the film is.
fn film(viewer: &mut Viewer, ui: &mut Ui) {
    if let Some((done, count)) = viewer.panels.path.filming {
        ui.add(ProgressBar::new(done as f32 / count.max(1) as f32).text(format!("{done} of {count}")));
        if ui.button("Cancel").clicked() {
            viewer.send(Command::CancelFilm);
        }
        return;
    }
    let ready = viewer.panels.path.keyframes() > 0;
    let button = ui.add_enabled(ready, egui::Button::new("Render film"));
    let text = "Write every frame as PNG, in the mode that is shown, and a video where ffmpeg is on this machine";
    if button.on_hover_text(text).clicked()
        && let Some(film) = film_of(viewer)
    {
        viewer.panels.path.filming = Some((0, film.cameras.len()));
        viewer.send(Command::Film(Box::new(film)));
    }
}
