//! From photos to a scene: what the window asks for, and how it follows that.

use crate::worker::{Message, Post};
use eframe::egui::ProgressBar;
use ibgs_core::progress::{Progress, duration};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use web_time::Instant;

/// A scene that is to be made of photos; all else is at its default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PhotosRequest {
    /// A folder of photos, or a video.
    pub input: PathBuf,
    /// The scene folder to make; none: beside the input, with its name and `-scene`.
    pub scene: Option<PathBuf>,
    /// Most frames that are taken from a video; none: as usual.
    pub frames: Option<u32>,
    /// Whether a folder that was begun with other photos or options is begun anew.
    pub anew: bool,
}

/// What the window is told of a preparation.
pub enum Sign {
    /// A sentence for the user.
    Note(String),
    /// Work of this many steps begins.
    Begin(&'static str, usize),
    /// One step of it is done.
    Step,
    /// It has ended.
    End,
    /// The scene is made.
    Made(PathBuf),
    /// It cannot be made, in one sentence.
    Failed(String),
    /// The whole has ended because the user wanted it to.
    Stopped,
}

/// Reports a preparation to the window.
pub struct Watch {
    post: Post,
    stop: Arc<AtomicBool>,
}

impl Watch {
    pub(crate) fn new(post: Post, stop: Arc<AtomicBool>) -> Self {
        Self { post, stop }
    }

    /// A sentence for the user.
    pub fn note(&self, sentence: String) {
        self.send(Sign::Note(sentence));
    }

    /// Becomes true once the preparation is to stop.
    pub fn stop(&self) -> Arc<AtomicBool> {
        self.stop.clone()
    }

    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    pub(crate) fn send(&self, sign: Sign) {
        self.post.send(Message::Preparing(sign));
    }
}

impl Progress for Watch {
    fn begin(&self, what: &'static str, steps: usize) {
        self.send(Sign::Begin(what, steps));
    }

    fn step(&self) {
        self.send(Sign::Step);
    }

    fn end(&self) {
        self.send(Sign::End);
    }
}

/// Work that is being done.
pub(crate) struct Bar {
    pub what: &'static str,
    pub done: usize,
    pub steps: usize,
    since: Instant,
}

impl Bar {
    /// Work that begins.
    pub fn new(what: &'static str, steps: usize) -> Self {
        Self { what, done: 0, steps, since: Instant::now() }
    }

    /// How far it is, to be shown.
    pub fn widget(&self) -> ProgressBar {
        let left = self.left().map_or_else(String::new, |left| format!(", {} left", duration(left)));
        let text = format!("{}: {} of {}{left}", self.what, self.done, self.steps);
        ProgressBar::new(self.done as f32 / self.steps.max(1) as f32).text(text)
    }

    /// Seconds that are left at the speed so far; none before the first step.
    pub fn left(&self) -> Option<f64> {
        let (done, steps) = (self.done as f64, self.steps as f64);
        (self.done > 0).then(|| self.since.elapsed().as_secs_f64() / done * (steps - done).max(0.0))
    }
}

/// A preparation as the window knows it.
#[derive(Default)]
pub(crate) struct Preparing {
    /// It is being done.
    pub runs: bool,
    /// It was told to stop.
    pub stops: bool,
    /// What it has said, the oldest first.
    pub notes: Vec<String>,
    pub bar: Option<Bar>,
}

impl Preparing {
    /// Begins one.
    pub fn begin(&mut self) {
        *self = Self { runs: true, ..Self::default() };
    }

    /// Takes what is told; what was said stays after the end.
    pub fn take(&mut self, sign: &Sign) {
        if matches!(sign, Sign::Made(_) | Sign::Failed(_) | Sign::Stopped) {
            (self.runs, self.stops, self.bar) = (false, false, None);
        }
        match sign {
            Sign::Note(sentence) => self.notes.push(sentence.clone()),
            &Sign::Begin(what, steps) => self.bar = Some(Bar::new(what, steps)),
            Sign::Step => self.bar.iter_mut().for_each(|bar| bar.done = (bar.done + 1).min(bar.steps)),
            Sign::End => self.bar = None,
            Sign::Made(scene) => self.notes.push(format!("The scene is {}.", scene.display())),
            Sign::Failed(_) => {}
            Sign::Stopped => self.notes.push("Stopped. \"Find poses\" goes on from here.".to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preparation_is_followed_to_its_end() {
        let mut preparing = Preparing { notes: vec!["of before".to_owned()], ..Preparing::default() };
        preparing.begin();
        preparing.take(&Sign::Note("finding features".to_owned()));
        preparing.take(&Sign::Begin("features", 2));
        assert_eq!(preparing.bar.as_ref().unwrap().left(), None);
        for _ in 0..3 {
            preparing.take(&Sign::Step);
        }
        let bar = preparing.bar.as_ref().unwrap();
        assert_eq!((bar.what, bar.done, bar.left()), ("features", 2, Some(0.0)));
        preparing.take(&Sign::End);
        assert!(preparing.bar.is_none() && preparing.runs);
        preparing.take(&Sign::Stopped);
        assert!(!preparing.runs);
        assert_eq!((preparing.notes.len(), &*preparing.notes[0]), (2, "finding features"));
    }
}
