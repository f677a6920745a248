//! Leaving a model with unsaved edits: the window asks first. What was asked for waits for the answer.

use super::Viewer;
use crate::OpenRequest;
use eframe::egui::{Context, ViewportCommand};

/// What waits for the answer.
pub(crate) enum Next {
    /// The window is closed.
    Close,
    /// Something else is opened.
    Open(OpenRequest),
}

/// The question that is open.
pub(crate) struct Leaving {
    /// What follows once the edits are saved or given up.
    pub next: Next,
    /// They are being saved.
    pub saving: bool,
}

/// What the user answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    Save,
    Discard,
    Cancel,
}

impl Viewer {
    /// Calls `told` each time that the user was to leave and decided to stay.
    pub fn when_kept_open(&mut self, told: impl Fn() + Send + 'static) {
        self.kept_open = Some(Box::new(told));
    }

    /// Whether the window asks what becomes of unsaved edits.
    pub fn asks_to_leave(&self) -> bool {
        self.leaving.is_some()
    }

    /// Keeps the window open where edits would be lost, and asks. Runs also while the window is hidden.
    pub(crate) fn guard(&mut self, ctx: &Context) {
        if !ctx.input(|input| input.viewport().close_requested()) || self.closes || !self.edit.is_unsaved() {
            return;
        }
        // A window that is hidden or behind others is to be seen asking.
        for command in [ViewportCommand::CancelClose, ViewportCommand::Minimized(false), ViewportCommand::Focus] {
            ctx.send_viewport_cmd(command);
        }
        self.ask(Next::Close);
    }

    /// Asks before what follows; a question that is open gets another sequel.
    pub(super) fn ask(&mut self, next: Next) {
        let saving = self.leaving.as_ref().is_some_and(|leaving| leaving.saving);
        self.error = self.error.take().filter(|_| saving);
        self.leaving = Some(Leaving { next, saving });
    }

    /// Does what the user has answered.
    pub(crate) fn answered(&mut self, answer: Answer, ctx: &Context) {
        match answer {
            Answer::Save => {
                if self.save_edited()
                    && let Some(leaving) = &mut self.leaving
                {
                    leaving.saving = true;
                }
            }
            Answer::Discard => self.go_on(ctx),
            Answer::Cancel => {
                self.leaving = None;
                self.kept_open.iter().for_each(|told| told());
            }
        }
    }

    /// Goes on once the model has been saved; after a failure the question is open again.
    pub(super) fn saved_or_not(&mut self, ctx: &Context) {
        let Some(leaving) = &mut self.leaving else { return };
        if !self.edit.is_unsaved() {
            self.go_on(ctx);
        } else if self.doing.is_none() {
            leaving.saving = false;
        }
    }

    fn go_on(&mut self, ctx: &Context) {
        match self.leaving.take().map(|leaving| leaving.next) {
            Some(Next::Close) => {
                self.closes = true;
                ctx.send_viewport_cmd(ViewportCommand::Close);
            }
            Some(Next::Open(wanted)) => self.request(wanted),
            None => {}
        }
    }
}
