//! A training in the viewer's window.

use super::terminal::print;
use anyhow::Result;
use ibgs_core::output::log::TrainingProgress;
use ibgs_core::render::Renderer;
use ibgs_train::Session;
use ibgs_train::session::{Event, Observer};
use ibgs_viewer::Training;
use std::path::PathBuf;

/// A session that the viewer trains.
pub struct Watched(Session);

impl Watched {
    /// Wraps a session for the window.
    pub fn new(session: Session) -> Self {
        Self(session)
    }

    /// The session.
    pub fn session(&self) -> &Session {
        &self.0
    }
}

/// Reports work in progress to the window and the other events to the terminal.
struct Both<'a>(&'a dyn Fn(&str));

impl Observer for Both<'_> {
    fn event(&mut self, event: &Event) {
        if matches!(event, Event::Measuring | Event::Saving) {
            (self.0)(&event.to_string());
        }
        print(event);
    }
}

impl Training for Watched {
    fn step(&mut self, status: &dyn Fn(&str)) -> Result<()> {
        Ok(self.0.step(&mut Both(status))?)
    }

    fn progress(&self) -> TrainingProgress {
        self.0.progress()
    }

    fn renderer(&self) -> Result<Renderer> {
        Ok(self.0.renderer()?)
    }

    fn save(&mut self) -> Result<Option<PathBuf>> {
        Ok(self.0.save()?)
    }

    fn finish(&mut self) -> Result<()> {
        Ok(self.0.finish(&mut Both(&|_| {}))?)
    }
}
