//! Which modes there are, and which are shown.

use super::Viewer;
use crate::mode::Mode;

impl Viewer {
    /// What the model or the camera's place lacks of what a mode shows. The network of a training comes later, and that of a
    /// model is known once there is a frame of it: until then the final image is what there is.
    pub(crate) fn lacks(&self, mode: Mode) -> Option<&'static str> {
        let has_photo = || self.view().is_some_and(|view| view.photo.is_some());
        let has_network = || match self.canvas.last() {
            Some(last) => last.facts.sources.is_some() || mode == Mode::Final && self.training.is_some(),
            None => mode == Mode::Final,
        };
        if mode.needs_network() && !has_network() {
            let trains = self.training.is_some();
            return Some(if trains { "Its network is not trained yet" } else { "This model has no residual network" });
        }
        (mode.needs_photo() && !has_photo()).then_some("The camera stands on no view with a photo")
    }

    /// Whether a model with a network shows a frame in which no pixel sees a source photo: its final image is the base.
    pub fn lacks_sources(&self) -> bool {
        self.canvas.last().is_some_and(|last| last.facts.most_seen == Some(0))
    }

    /// Whether the model and the camera's place have what a mode shows.
    pub fn offers(&self, mode: Mode) -> bool {
        self.lacks(mode).is_none()
    }

    /// Whether a mode that is wanted is shown, alone or beside another one.
    pub(crate) fn shows(&self, wanted: impl Fn(Mode) -> bool) -> bool {
        wanted(self.mode) || self.other.is_some_and(wanted)
    }

    /// Shows another part of the image, where there is one.
    pub fn show_mode(&mut self, mode: Mode) {
        if self.offers(mode) {
            (self.mode, self.lacks_final) = (mode, false);
        }
    }

    /// Shows a mode right of a divider, or one mode alone.
    pub fn show_other(&mut self, mode: Option<Mode>) {
        self.other = mode.filter(|&mode| self.offers(mode));
    }

    pub(super) fn leave_what_is_not_offered(&mut self) {
        let offers_final = self.offers(Mode::Final);
        if !self.offers(self.mode) {
            (self.mode, self.lacks_final) = if offers_final { (Mode::Final, false) } else { (Mode::Base, true) };
        } else if self.lacks_final && offers_final {
            // Its network has come.
            (self.mode, self.lacks_final) = (Mode::Final, false);
        }
        self.other = self.other.filter(|&mode| self.offers(mode));
    }
}
