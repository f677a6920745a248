//! The form for photos without poses, and how far their preparation is.

use crate::preparing::{PhotosRequest, Preparing};
use crate::train_form::{PathField, row};
use eframe::egui::{Button, Grid, ScrollArea, TextEdit, Ui};
use std::path::PathBuf;

/// What comes next where photos have no poses, in the window and from the command line.
pub const NEXT: &str =
    "\"Find poses\" estimates where the photos were taken, as `ibgs prepare` does; then \"Train\" trains on the scene";

/// Height of the list of what was said, in points.
const NOTES: f32 = 110.0;
/// Fewest frames of a video.
const FEWEST: u32 = 3;

/// What the user asks the form for.
pub enum Asked {
    /// A folder of photos from a file dialog.
    BrowsePhotos,
    /// A video from a file dialog.
    BrowseVideo,
    /// A scene of the photos.
    Prepare(PhotosRequest),
    /// The end of the preparation.
    Stop,
}

/// What the form holds.
#[derive(Debug, Default)]
pub struct PhotosForm {
    pub input: PathField,
    scene: PathField,
    /// As typed; empty: as usual.
    frames: String,
    anew: bool,
    /// Why it cannot be used, in one sentence.
    error: Option<String>,
}

impl PhotosForm {
    /// Asks for a scene of these photos.
    pub fn set_input(&mut self, path: PathBuf) {
        self.input.set(path);
        self.error = None;
    }

    /// The scene that it describes, or a sentence that says what is missing.
    fn request(&self) -> Result<PhotosRequest, String> {
        let input = self.input.path().ok_or("choose a folder of photos or a video")?;
        let text = self.frames.trim();
        let frames = match text.parse() {
            _ if text.is_empty() => None,
            Ok(frames) if frames >= FEWEST => Some(frames),
            _ => return Err(format!("`{text}` is not a number of frames; give a whole number from {FEWEST}")),
        };
        Ok(PhotosRequest { input, scene: self.scene.path(), frames, anew: self.anew })
    }

    /// Shows the form, and a preparation; returns what was asked for.
    pub fn show(&mut self, preparing: &Preparing, ui: &mut Ui) -> Option<Asked> {
        let asked = ui.add_enabled_ui(!preparing.runs, |ui| self.fields(ui)).inner;
        // Below the field, which otherwise would lose the keyboard.
        if !self.input.text.is_empty() && !preparing.runs {
            ui.weak(format!("Next: {NEXT}."));
        }
        asked.or(follow(preparing, ui))
    }

    fn fields(&mut self, ui: &mut Ui) -> Option<Asked> {
        let (room, mut browsed) = ((ui.available_width() - 210.0).clamp(80.0, 260.0), None);
        Grid::new("photos form").num_columns(2).spacing([12.0, 8.0]).show(ui, |ui| {
            let label = ui.label("Photos or video").id;
            ui.horizontal(|ui| {
                let field = TextEdit::singleline(&mut self.input.text).hint_text("folder or video");
                ui.add(field.desired_width(room)).labelled_by(label).on_hover_text(
                    "Photos with much overlap, taken in steps around what they show; or a slow walk around it",
                );
                ui.menu_button("Browse...", |ui| {
                    for (name, asked) in [("Folder of photos", Asked::BrowsePhotos), ("Video", Asked::BrowseVideo)] {
                        if ui.button(name).clicked() {
                            browsed = Some(asked);
                            ui.close();
                        }
                    }
                });
            });
            ui.end_row();
            let text = "The folder that gets the photos and their poses; by default beside them, as NAME-scene";
            row(ui, "Make scene", &mut self.scene.text, ("beside it", room), text);
            let text = "At most so many, the sharpest, spread by how much the camera moves";
            row(ui, "Frames of a video", &mut self.frames, ("150", 80.0), text);
        });
        ui.add_space(4.0);
        ui.horizontal(|ui| {
            let clicked = ui.button("Find poses").on_hover_text("Runs COLMAP, for a video also ffmpeg").clicked();
            ui.checkbox(&mut self.anew, "begin anew")
                .on_hover_text("Replace what was made here before with other photos or options");
            // What is missing is said until it is there.
            let wanted = (clicked || self.error.is_some()).then(|| self.request());
            if let Some(wanted) = &wanted {
                self.error = wanted.as_ref().err().cloned();
            }
            wanted.filter(|_| clicked)
        })
        .inner
        .and_then(|wanted| {
            // What this one does is to be gone on with.
            self.anew &= wanted.is_err();
            wanted.ok().map(Asked::Prepare)
        })
        .or_else(|| {
            if let Some(error) = &self.error {
                ui.colored_label(ui.visuals().error_fg_color, error);
            }
            browsed
        })
    }
}

/// How far it is, and what it has said.
fn follow(preparing: &Preparing, ui: &mut Ui) -> Option<Asked> {
    let mut stop = false;
    if preparing.runs {
        ui.horizontal(|ui| {
            match &preparing.bar {
                Some(bar) => {
                    let width = (ui.available_width() - 80.0).max(80.0);
                    ui.add(bar.widget().desired_width(width));
                }
                None => {
                    ui.spinner();
                    ui.label("at work");
                }
            }
            let button = ui.add_enabled(!preparing.stops, Button::new("Stop"));
            stop = button.on_hover_text("What is done is kept").clicked();
        });
    }
    if !preparing.notes.is_empty() {
        ScrollArea::vertical()
            .id_salt("notes")
            .max_height(NOTES)
            .auto_shrink([false, true])
            .stick_to_bottom(true)
            .show(ui, |ui| {
                for note in &preparing.notes {
                    ui.label(note);
                }
            });
    }
    stop.then_some(Asked::Stop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_form_asks_for_what_it_holds() {
        let mut form = PhotosForm::default();
        assert!(form.request().unwrap_err().contains("choose a folder of photos"));
        form.set_input("photos".into());
        let usual = PhotosRequest { input: "photos".into(), ..PhotosRequest::default() };
        assert_eq!(form.request(), Ok(usual));
        for wrong in ["2", "many", "-1"] {
            wrong.clone_into(&mut form.frames);
            assert!(form.request().unwrap_err().contains(&format!("`{wrong}` is not a number of frames")));
        }
        " 40 ".clone_into(&mut form.frames);
        form.scene.set("my-scene".into());
        form.anew = true;
        let expected =
            PhotosRequest { input: "photos".into(), scene: Some("my-scene".into()), frames: Some(40), anew: true };
        assert_eq!(form.request(), Ok(expected));
    }
}
