//! The editor's state: what is selected of a finished model, by which tool, and what was removed. Draws nothing.

use crate::edit_work::{EditCommand, EditMessage, SaveEdited};
use crate::worker::{Command, Rendered};
use crate::{Scene, Viewer};
use glam::{DVec2, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::edit::{Brush, Combine, CropBox, Editor, Filter, Mask};
use ibgs_core::scene::Gaussians;
use std::path::{Path, PathBuf};

/// Part of the Gaussians that the first box leaves out at each of its faces.
const OUTSIDE: f64 = 0.1;

/// What the pointer does in the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tool {
    /// Drags the faces of a box.
    Box,
    /// Paints.
    Brush,
}

/// A limit that can be switched on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Limit {
    /// It counts.
    pub on: bool,
    /// Its value.
    pub value: f64,
}

impl Limit {
    fn get(self) -> Option<f64> {
        self.on.then_some(self.value)
    }
}

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
    /// How a new selection and the one before become one.
    pub how: Combine,
    /// The box, once the Gaussians are there.
    pub crop: Option<CropBox>,
    /// Radius of the brush in points of the window.
    pub radius: f32,
    /// The brush leaves out what is hidden.
    pub in_front: bool,
    /// Limits of opacity, size and distance.
    pub limits: [Limit; 3],
    /// Where the distance is measured from: the middle of the cameras.
    pub middle: DVec3,
    /// Where the model is saved.
    pub file: String,
    /// An existing file is replaced.
    pub replaces: bool,
    /// Revision of the Gaussians that the worker has to keep; each revision is another model.
    pub revision: u32,
    /// Revision that was saved last.
    pub saved: u32,
    /// Where the brush was last, as shares of the image.
    stroke: Option<DVec2>,
}

impl Edit {
    /// The editor of what was opened.
    pub fn of(scene: &Scene, middle: DVec3, extent: f64) -> Self {
        let limit = |value| Limit { on: false, value };
        Self {
            radius: 24.0,
            in_front: true,
            limits: [limit(0.1), limit(0.1 * extent), limit(2.0 * extent)],
            middle,
            file: file_name(scene).display().to_string(),
            ..Self::default()
        }
    }

    /// Asks the worker for the Gaussians, once.
    pub fn begin(&mut self) -> Option<Command> {
        let asks = self.shown && !self.asked;
        // If no Gaussians came, closing and reopening the editor asks again.
        self.asked = self.shown || self.editor.is_some();
        asks.then_some(Command::Edit(EditCommand::Begin))
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
            EditMessage::Saved(text, revision) => {
                self.saved = revision;
                Some(text)
            }
        }
    }

    /// Whether the pointer's main button paints.
    pub fn paints(&self) -> bool {
        self.shown && self.editor.is_some() && self.tool == Some(Tool::Brush)
    }

    /// Whether the brush needs the depths of the image.
    pub fn needs_depths(&self) -> bool {
        self.paints() && self.in_front
    }

    /// Whether something was removed since the model was saved.
    pub fn is_unsaved(&self) -> bool {
        self.revision != self.saved && self.editor.as_ref().is_some_and(Editor::is_changed)
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

    /// The limits that count.
    pub fn filter(&self) -> Filter {
        let [opacity, size, distance] = self.limits;
        Filter {
            opacity_below: opacity.get(),
            scale_above: size.get(),
            farther: distance.get().map(|limit| (self.middle, limit)),
        }
    }

    /// Selects what meets the limits.
    pub fn select_filter(&mut self) {
        let filter = self.filter();
        if let Some(editor) = &mut self.editor {
            editor.select(&filter.found(editor.gaussians()), self.how);
        }
    }

    /// The brush is pressed at a place of the image, 0 to 1 in both directions; `radius` in heights of the image.
    pub fn paint(&mut self, at: DVec2, radius: f64, camera: &Camera, last: Option<&Rendered>) {
        // The depths of the last frame show what is hidden, if it is of this camera.
        let last = last.filter(|last| last.frame.camera().has_pose_of(camera));
        let depths = last.and_then(|last| Some((last.depths.clone()?, *last.frame.camera())));
        let (depths, camera) = match (self.in_front, depths) {
            (false, _) => (None, *camera),
            (true, Some((depths, camera))) => (Some(depths), camera),
            (true, None) => return,
        };
        let Some(editor) = &mut self.editor else { return };
        let pixels = |share: DVec2| share * DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let from = self.stroke.replace(at);
        if from == Some(at) {
            return;
        }
        if from.is_none() {
            editor.begin();
            if self.how == Combine::Replace {
                editor.change(&Mask::none(editor.gaussians().len()), Combine::Replace);
            }
        }
        let brush = Brush {
            camera: &camera,
            ends: [from.unwrap_or(at), at].map(pixels),
            radius: radius * f64::from(camera.height),
            in_front_of: depths.as_deref(),
        };
        let how = if self.how == Combine::Remove { Combine::Remove } else { Combine::Add };
        editor.change(&brush.found(editor.gaussians()), how);
    }

    /// The brush is lifted.
    pub fn lift(&mut self) {
        if self.stroke.take().is_some()
            && let Some(editor) = &mut self.editor
        {
            editor.end();
        }
    }

    /// Applies a step that returns whether it changed the model; returns the command for the worker if it did.
    pub fn step(&mut self, step: impl FnOnce(&mut Editor) -> bool) -> Option<Command> {
        self.lift();
        let editor = self.editor.as_mut()?;
        if !step(editor) {
            return None;
        }
        self.revision += 1;
        Some(Command::Edit(EditCommand::Leave(editor.left().clone(), self.revision)))
    }

    /// Saves what is left.
    pub fn save(&self, scene: &Scene) -> Option<Command> {
        let left = self.editor.as_ref()?.left().clone();
        let path = PathBuf::from(self.file.trim());
        let (replaces, model) = (self.replaces, scene.model.clone());
        let save = SaveEdited { path, replaces, left, model, revision: self.revision };
        Some(Command::Edit(EditCommand::Save(Box::new(save))))
    }
}

impl Viewer {
    /// Shows or hides the editor.
    pub fn show_editor(&mut self, shown: bool) {
        self.edit.shown = shown && self.training.is_none();
    }

    /// Gaussians that are left and that are selected; none while they are not there.
    pub fn edited(&self) -> Option<[usize; 2]> {
        self.edit.editor.as_ref().map(|editor| [editor.left_count(), editor.selected_count()])
    }

    /// Where an edited model is saved.
    pub fn set_model_file(&mut self, path: &Path) {
        self.edit.file = path.display().to_string();
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
