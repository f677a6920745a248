//! Films and the pictures of keyframes that the worker renders between two frames.

use super::messages::{KeyframeRequest, Message};
use super::{Work, WorkerState};
use crate::film;
use anyhow::Result;
use ibgs_core::present::Presenter;
use ibgs_core::render::Renderer;

impl WorkerState {
    pub(super) fn film_failed(&self, error: &anyhow::Error) {
        self.send(Message::FilmDone(None));
        self.failed(error);
    }

    /// The next frame of a film.
    pub(super) fn shoot(&self, work: &mut Work) {
        let Some(mut shoot) = work.film.take() else { return };
        match work.renderer().map(|(renderer, _)| shoot.next(&renderer)) {
            Some(Ok(None)) => {
                self.send(Message::Filmed(shoot.done()));
                work.film = Some(shoot);
            }
            Some(Ok(written)) => self.send(Message::FilmDone(written)),
            Some(Err(error)) => self.film_failed(&error),
            None => self.send(Message::FilmDone(None)),
        }
    }

    /// What a keyframe shows; without a picture where it cannot be rendered.
    pub(super) fn picture_keyframe(&self, work: &mut Work, wanted: KeyframeRequest) {
        let picture = |renderer: &Renderer| -> Result<Vec<u8>> {
            let mut presenter = Presenter::new(self.gpu.clone())?;
            film::picture(renderer, &mut presenter, &wanted.camera, (wanted.mode, &wanted.style))
        };
        let rgb = work.renderer().map(|(renderer, _)| picture(&renderer)).transpose().unwrap_or_else(|error| {
            self.failed(&error);
            None
        });
        self.send(Message::Keyframe(Box::new(wanted), rgb));
    }
}
