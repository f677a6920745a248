//! What those who hold the window read of it and set: a page, or a test.

use super::{Over, Viewer};
use crate::Scene;
use crate::dialogs::Dialog;
use crate::mode::Mode;
use crate::navigator::Navigator;
use ibgs_core::inspect::Inspection;
use ibgs_core::output::log::TrainingProgress;
use std::path::{Path, PathBuf};

impl Viewer {
    /// What the canvas shows.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// What it shows right of the divider.
    pub fn other_mode(&self) -> Option<Mode> {
        self.other
    }

    /// The view that the camera stands on.
    pub fn on_view(&self) -> Option<usize> {
        self.on_view
    }

    /// Where the camera is.
    pub fn navigator(&self) -> &Navigator {
        &self.navigator
    }

    /// What is open.
    pub fn scene(&self) -> Option<&Scene> {
        self.scene.as_ref()
    }

    /// How far the training is, and whether it continues.
    pub fn progress(&self) -> Option<(&TrainingProgress, bool)> {
        self.training.as_ref().map(|trained| (&trained.progress, trained.running))
    }

    /// The pixel that was asked about last.
    pub fn inspection(&self) -> Option<&Inspection> {
        self.found.as_ref().map(|found| &found.inspection)
    }

    /// Keyframes of the camera path.
    pub fn keyframes(&self) -> usize {
        self.panels.path.keyframes()
    }

    /// Width and height of the last frame in pixels.
    pub fn image_size(&self) -> Option<[u32; 2]> {
        self.canvas.last().map(|last| [last.frame.camera().width, last.frame.camera().height])
    }

    /// Where the line between two modes stands, in points from the window's left.
    pub fn divider(&self) -> Option<f32> {
        self.other.and(self.divider_x)
    }

    /// On a view, shows nothing around its photo.
    pub fn show_only_frame(&mut self, only: bool) {
        self.panels.only_frame = only;
    }

    /// Shows or hides time, size and memory of the image.
    pub fn show_figures(&mut self, shown: bool) {
        self.panels.hides_figures = !shown;
    }

    /// Whether a resting camera's image has the full size, however long it takes.
    pub fn show_always_sharp(&mut self, on: bool) {
        self.settings.always_sharp = on;
    }

    /// Shows or hides the settings.
    pub fn show_settings(&mut self, shown: bool) {
        self.panels.put_over(Over::Settings, shown);
    }

    /// What is asked in place of the system's file dialogs.
    pub fn set_file_dialog(&mut self, pick: impl Fn() -> Option<PathBuf> + Send + Sync + 'static) {
        self.start.dialog = Dialog::new(move |_| pick());
    }

    /// Shows or hides the camera path.
    pub fn show_path(&mut self, shown: bool) {
        self.panels.shows_path = shown;
        self.panels.folds_facts &= !shown;
    }

    /// Where the camera path is saved and loaded.
    pub fn set_path_file(&mut self, path: &Path) {
        self.panels.path.set_file(path);
    }

    /// What was done last, in one sentence.
    pub fn message(&self) -> Option<&str> {
        self.message.as_deref()
    }

    /// What went wrong last, in one sentence.
    pub fn error(&self) -> Option<&str> {
        self.error.as_deref()
    }

    /// Whether the last frame or the start page is up to date and no work is in progress.
    pub fn is_settled(&self) -> bool {
        let has_all = match self.start.shown {
            true => self.start.is_complete(),
            false => self.scene.is_none() || self.canvas.is_settled(),
        };
        let path = &self.panels.path;
        let draws = self.panels.shows_path && path.awaits_pictures();
        let works = self.doing.is_some() || self.start.preparing.runs || self.share.runs || draws;
        !works && !self.moving() && has_all
    }
}
