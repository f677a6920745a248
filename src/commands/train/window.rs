//! A training in the viewer's window.

use super::terminal::{is_status, print};
use crate::advice;
use anyhow::{Error, Result, bail};
use ibgs_core::output::log::TrainingProgress;
use ibgs_core::render::Renderer;
use ibgs_train::Session;
use ibgs_train::session::{Event, JsonLines, Observer, SessionError};
use ibgs_viewer::Training;
use std::fs::File;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// Why a training in the window has failed, to report it once the window is closed. Clones share the error.
#[derive(Clone, Debug, Default)]
pub struct Failure(Arc<Mutex<Option<String>>>);

impl Failure {
    /// Keeps an error as a sentence; the first one is the cause of others.
    fn keep(&self, error: SessionError) -> Error {
        let error = Error::from(error);
        let sentence = || advice::sentence(&error);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(sentence);
        error
    }

    /// The end of the program.
    ///
    /// # Errors
    /// What a training failed with.
    pub fn outcome(&self) -> Result<()> {
        match self.0.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(sentence) => bail!("{sentence}"),
            None => Ok(()),
        }
    }
}

/// A session that the viewer trains.
pub struct Watched {
    session: Session,
    log: Option<JsonLines<File>>,
    failure: Failure,
}

impl Watched {
    /// Wraps a session for the window; it keeps its errors in `failure`.
    pub fn new(session: Session, failure: &Failure) -> Self {
        Self { session, log: None, failure: failure.clone() }
    }

    /// The same with records for `log` where there is one.
    pub fn with_log(self, log: Option<JsonLines<File>>) -> Self {
        Self { log, ..self }
    }

    /// The session.
    pub fn session(&self) -> &Session {
        &self.session
    }
}

/// Reports work in progress to the window, and the other events to the terminal and the log.
struct All<'a> {
    window: &'a dyn Fn(&str),
    log: &'a mut Option<JsonLines<File>>,
}

impl Observer for All<'_> {
    fn event(&mut self, event: &Event) {
        if is_status(event) {
            (self.window)(&event.to_string());
        }
        print(event);
        self.log.event(event);
    }
}

impl Training for Watched {
    fn step(&mut self, status: &dyn Fn(&str)) -> Result<()> {
        let stepped = self.session.step(&mut All { window: status, log: &mut self.log });
        stepped.map_err(|error| self.failure.keep(error))?;
        if self.log.is_some() {
            let _ = self.log.iteration(&self.session.progress());
        }
        Ok(())
    }

    fn progress(&self) -> TrainingProgress {
        self.session.progress()
    }

    fn renderer(&self) -> Result<Renderer> {
        Ok(self.session.renderer()?)
    }

    fn save(&mut self) -> Result<Option<PathBuf>> {
        Ok(self.session.save()?)
    }

    fn finish(&mut self) -> Result<()> {
        let finished = self.session.finish(&mut All { window: &|_| {}, log: &mut self.log });
        finished.map_err(|error| self.failure.keep(error))
    }
}
