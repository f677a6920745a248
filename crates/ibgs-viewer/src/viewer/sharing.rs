//! Writing the model for others.

use super::{Over, Viewer};
use crate::share::ShareRequest;
use crate::worker::Command;
use std::path::PathBuf;

impl Viewer {
    /// The model that can be shared: one that is on disk, and whose training has ended.
    pub(crate) fn shared_model(&self) -> Option<PathBuf> {
        let trains = self.training.as_ref().is_some_and(|trained| trained.end.is_none());
        self.scene.as_ref().filter(|_| !trains)?.path.clone()
    }

    pub(crate) fn write_shared(&mut self, wanted: ShareRequest) {
        (self.error, self.message) = (None, None);
        (self.share.runs, self.share.said) = (true, Vec::new());
        self.send(Command::Share(Box::new(wanted)));
    }

    /// Takes what was said of it.
    pub(super) fn shared(&mut self, outcome: Result<Vec<String>, String>) {
        self.share.runs = false;
        match outcome {
            Ok(said) => {
                // The panel says it, where it is open.
                if self.panels.over != Some(Over::Share) {
                    self.message = said.last().cloned();
                }
                self.share.said = said;
            }
            Err(error) => self.error = Some(error),
        }
    }
}
