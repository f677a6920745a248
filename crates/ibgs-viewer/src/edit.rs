//! The editor's state: what is selected of a finished model, by which tool, and what was hidden and removed. Draws nothing.

mod gizmo;
mod placing;
mod ranges;
mod tools;

pub use gizmo::{Gizmo, Handle};
pub use ranges::{Quantity, Ranges};
pub use tools::{Picture, Tool, is_of_tool};

use crate::edit_work::{EditCommand, EditMessage, EditShown, SaveEdited};
use crate::worker::Command;
use crate::{Scene, Viewer};
use gizmo::Held;
use glam::{DVec2, DVec3};
use ibgs_core::edit::{Combine, CropBox, Editor, Floaters, Mask};
use ibgs_core::scene::Gaussians;
use ibgs_core::similarity::Similarity;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Part of the Gaussians that the first box leaves out at each of its faces.
const OUTSIDE: f64 = 0.1;
/// Parts of the scene's extent: gaps that a flood crosses at first, and gaps that make a floater.
const FLOOD_GAP: f64 = 0.02;
const FLOATER_GAP: f64 = 0.05;
/// Groups of fewer Gaussians are floaters at first.
const FLOATER_SIZE: usize = 100;

/// The editor of the model that is open.
#[derive(Default)]
pub struct Edit {
    /// The panel is shown.
    pub shown: bool,
    /// Selection and steps; none until the worker has sent the Gaussians.
    pub editor: Option<Editor>,
    asked: bool,
    /// What the pointer does; none: it moves the camera.
    pub tool: Option<Tool>,
    /// How a new selection and the one before become one, where no key says so.
    pub how: Combine,
    /// The box, once the Gaussians are there.
    pub crop: Option<CropBox>,
    /// Radius of the brush in points of the window.
    pub radius: f32,
    /// Brush and outlines leave out what is hidden behind the surface.
    pub in_front: bool,
    /// Largest difference of colours that are taken for one.
    pub tolerance: f64,
    /// Largest gap that a flood crosses, in scene units.
    pub gap: f64,
    /// A flood stays within the tolerance of the first colour.
    pub same_color: bool,
    /// What floats.
    pub floaters: Option<Floaters>,
    /// Selection by a value.
    pub ranges: Ranges,
    /// Where the distance is measured from: the middle of the cameras.
    pub middle: DVec3,
    /// Where the model is saved.
    pub file: String,
    /// An existing file is replaced.
    pub replaces: bool,
    /// Number of the state that the worker has to show.
    pub revision: u32,
    /// That state.
    sent: Option<EditShown>,
    /// What was saved last; none: the model as it was opened.
    saved: Option<(Arc<Mask>, Similarity)>,
    /// Where the pointer went since it was pressed, as shares of the image, and how its selection counts.
    stroke: Vec<DVec2>,
    stroke_how: Combine,
    /// Corners of the polygon so far, as shares of the image.
    pub polygon: Vec<DVec2>,
    /// It is to be closed.
    pub ends_polygon: bool,
    /// Points of the surface that were clicked to measure a length, or to set the ground.
    pub points: Vec<DVec3>,
    /// What the measured length is in truth.
    pub true_length: f64,
    /// The handle of the gizmo that the pointer holds.
    held: Option<Held>,
    /// Where the model stood in the last picture; none: where it was opened.
    stood: Option<Similarity>,
}

impl Edit {
    /// The editor of what was opened.
    pub fn of(scene: &Scene, middle: DVec3, extent: f64) -> Self {
        Self {
            radius: 24.0,
            tolerance: 0.15,
            gap: FLOOD_GAP * extent,
            floaters: Some(Floaters { gap: FLOATER_GAP * extent, least: FLOATER_SIZE }),
            middle,
            file: file_name(scene).display().to_string(),
            ..Self::default()
        }
    }

    /// What the worker has to do now: send the Gaussians, once, or show another state.
    pub fn command(&mut self) -> Option<Command> {
        let asks = self.shown && !self.asked;
        // If no Gaussians came, closing and reopening the editor asks again.
        self.asked = self.shown || self.editor.is_some();
        if asks && self.editor.is_none() {
            return Some(Command::Edit(EditCommand::Begin));
        }
        let editor = self.editor.as_ref()?;
        let left = editor.shown().clone();
        let marks = |edit: &Self| match edit.shown {
            true => editor.selected().clone(),
            false => Arc::new(Mask::none(left.total())),
        };
        let sent = self.sent.as_ref();
        // While the pointer is down, marks show what is selected.
        let tinted = match sent.filter(|_| !self.stroke.is_empty()) {
            Some(sent) => sent.tinted.clone(),
            None => marks(self),
        };
        let is_shown = match sent {
            Some(sent) => sent.left == left && sent.tinted == tinted,
            None => left.count() == left.total() && tinted.count() == 0,
        };
        if is_shown {
            return None;
        }
        self.revision += 1;
        let shown = EditShown { left, tinted, revision: self.revision };
        self.sent = Some(shown.clone());
        Some(Command::Edit(EditCommand::Show(shown)))
    }

    /// Whether a picture of this revision shows in colour what is selected.
    pub fn is_tinted(&self, revision: u32) -> bool {
        let selected = self.editor.as_ref().map(Editor::selected);
        revision == self.revision && self.sent.as_ref().map(|sent| &sent.tinted) == selected
    }

    /// Handles a message of the worker; returns a sentence to show to the user, if any.
    pub fn take(&mut self, message: EditMessage, up: DVec3) -> Option<String> {
        match message {
            EditMessage::Gaussians(gaussians) => {
                if self.editor.is_none() {
                    self.crop = CropBox::around(gaussians.positions(), up, 0.0, OUTSIDE);
                    self.editor = Some(Editor::new(gaussians));
                }
                None
            }
            EditMessage::Saved(text, left, placement) => {
                self.saved = Some((left, placement));
                Some(text)
            }
        }
    }

    /// Whether the model differs from what was saved, or opened.
    pub fn is_unsaved(&self) -> bool {
        let Some(editor) = &self.editor else { return false };
        match &self.saved {
            Some((left, placement)) => left != editor.left() || placement != editor.placement(),
            None => editor.left_count() < editor.gaussians().len() || *editor.placement() != Similarity::IDENTITY,
        }
    }

    /// Puts the box around what is selected, or around most of the model.
    pub fn fit_box(&mut self, up: DVec3) {
        let Some(editor) = &self.editor else { return };
        let turn = self.crop.map_or(0.0, |crop| crop.turn);
        let fitted = match editor.selected_count() {
            0 => CropBox::around(places(editor.gaussians(), editor.left(), 1), up, turn, OUTSIDE),
            _ => CropBox::around(places(editor.gaussians(), editor.selected(), 1), up, turn, 0.0),
        };
        self.crop = fitted.or(self.crop);
    }

    /// Selects what lies in the box, or what lies beside it.
    pub fn select_box(&mut self, inside: bool) {
        let (Some(editor), Some(crop)) = (&mut self.editor, &self.crop) else { return };
        let found = crop.found(editor.gaussians());
        let found = if inside { found } else { Mask::all(found.total()).without(&found) };
        editor.select(&found, self.how);
    }

    /// Removes what lies beside the box.
    pub fn crop(&mut self) {
        let (Some(editor), Some(crop)) = (&mut self.editor, &self.crop) else { return };
        editor.crop(&crop.found(editor.gaussians()));
    }

    /// Selects what floats, in place of what was selected.
    pub fn select_floaters(&mut self) {
        if let (Some(editor), Some(floaters)) = (&mut self.editor, &self.floaters) {
            editor.select(&floaters.found(editor.gaussians(), &editor.selectable()), Combine::Replace);
        }
    }

    /// Takes a step of the editor.
    pub fn step<T>(&mut self, step: impl FnOnce(&mut Editor) -> T) {
        self.lift();
        if let Some(editor) = &mut self.editor {
            step(editor);
        }
    }

    /// Saves what is left.
    pub fn save(&self, scene: &Scene) -> Option<Command> {
        let editor = self.editor.as_ref()?;
        let (left, placement) = (editor.left().clone(), *editor.placement());
        let path = PathBuf::from(self.file.trim());
        let (replaces, model) = (self.replaces, scene.model.clone());
        Some(Command::Edit(EditCommand::Save(Box::new(SaveEdited { path, replaces, left, placement, model }))))
    }
}

impl Viewer {
    /// Shows or hides the editor. A stroke that was not ended is forgotten.
    pub fn show_editor(&mut self, shown: bool) {
        self.edit.lift();
        self.edit.shown = shown && self.training.is_none();
        self.panels.folds_facts &= !self.edit.shown;
    }

    /// Gaussians that are left and that are selected; none while they are not there.
    pub fn edited(&self) -> Option<[usize; 2]> {
        self.edit.editor.as_ref().map(|editor| [editor.left_count(), editor.selected_count()])
    }

    /// Gaussians that are hidden and that are locked.
    pub fn kept_from_edits(&self) -> Option<[usize; 2]> {
        self.edit.editor.as_ref().map(|editor| [editor.hidden_count(), editor.locked_count()])
    }

    /// Whether values of the Gaussians are still to come; none where none is looked at.
    pub fn compares(&self) -> Option<bool> {
        self.edit.ranges.value.map(|_| self.edit.ranges.is_waiting())
    }

    /// Where an edited model is saved.
    pub fn set_model_file(&mut self, path: &Path) {
        self.edit.file = path.display().to_string();
    }

    /// Where the edited model stands, and the length that was measured there.
    pub fn placement(&self) -> Option<(&Similarity, Option<f64>)> {
        self.edit.editor.as_ref().map(|editor| (editor.placement(), self.edit.length()))
    }

    /// What the measured length is in truth, in the unit that the file is to have.
    pub fn set_true_length(&mut self, length: f64) {
        self.edit.true_length = length;
    }

    /// The editor's box.
    pub fn crop_box(&self) -> Option<&CropBox> {
        self.edit.crop.as_ref()
    }
}

/// Places of every `step`th Gaussian of a mask.
pub fn places<'a>(gaussians: &'a Gaussians, mask: &'a Mask, step: usize) -> impl Iterator<Item = DVec3> + 'a {
    mask.iter().step_by(step).map(|i| gaussians.space.to_scene(DVec3::from(gaussians.means[i].map(f64::from))))
}

/// The suggested file name: beside the opened file, and never that file itself.
fn file_name(scene: &Scene) -> PathBuf {
    let ending = if scene.model.is_some() { "ibgs" } else { "ply" };
    let Some(path) = &scene.path else { return PathBuf::from(format!("edited.{ending}")) };
    let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
    let name = name.map_or_else(|| "model".into(), |name| name.to_string_lossy());
    path.parent().unwrap_or(Path::new("")).join(format!("{name}-edited.{ending}"))
}
