//! The system's file dialogs. Each runs on a thread of its own, so the window answers while one is open.

use eframe::egui::Context;
#[cfg(not(target_arch = "wasm32"))]
use ibgs_core::scene::Format;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::Duration;
use web_time::Instant;

/// What is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sought {
    /// A model folder.
    ModelFolder,
    /// A bundle or a file of Gaussians.
    ModelFile,
    /// A scene to train on.
    Scene,
    /// A folder of photos without poses.
    Photos,
    /// A video.
    Video,
}

/// Nobody cancels a dialog so soon after it was asked for: there was none.
const UNSEEN: Duration = Duration::from_millis(250);

/// How a dialog ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// This was chosen.
    Chosen(Sought, PathBuf),
    /// The system has no file dialog.
    NoDialog,
}

/// What a dialog returned, and after which time.
type Returned = (Option<PathBuf>, Duration);

/// How a user is asked; it takes its time.
type Pick = Arc<dyn Fn(Sought) -> Option<PathBuf> + Send + Sync>;

/// The dialog that is open, if any.
pub struct Dialog {
    opened: Option<(Sought, Receiver<Returned>)>,
    pick: Pick,
}

impl Default for Dialog {
    fn default() -> Self {
        Self::new(native)
    }
}

impl Dialog {
    /// Dialogs that ask the user with `pick`.
    pub fn new(pick: impl Fn(Sought) -> Option<PathBuf> + Send + Sync + 'static) -> Self {
        Self { opened: None, pick: Arc::new(pick) }
    }

    /// Whether one is open.
    pub fn is_open(&self) -> bool {
        self.opened.is_some()
    }

    /// Asks the user; does nothing while a dialog is open.
    pub fn open(&mut self, sought: Sought, window: &Context) {
        if self.is_open() {
            return;
        }
        let (sender, answer) = channel();
        let (window, pick) = (window.clone(), self.pick.clone());
        let started = std::thread::Builder::new().name("file dialog".to_owned()).spawn(move || {
            // The receiver is gone once the window is closed.
            let begun = Instant::now();
            let _ = sender.send((pick(sought), begun.elapsed()));
            window.request_repaint();
        });
        self.opened = started.ok().map(|_| (sought, answer));
    }

    /// How it ended, once; nothing where the dialog was cancelled.
    pub fn answer(&mut self) -> Option<Answer> {
        let (sought, answer) = self.opened.as_ref()?;
        let (sought, answer) = (*sought, answer.try_recv());
        if answer == Err(TryRecvError::Empty) {
            return None;
        }
        self.opened = None;
        match answer {
            Ok((Some(path), _)) => Some(Answer::Chosen(sought, path)),
            Ok((None, after)) => (after < UNSEEN).then_some(Answer::NoDialog),
            Err(_) => Some(Answer::NoDialog),
        }
    }
}

/// The system's own dialog; a browser has none.
#[cfg(target_arch = "wasm32")]
fn native(_: Sought) -> Option<PathBuf> {
    None
}

/// The last parts of the names of bundles and files of Gaussians.
#[cfg(not(target_arch = "wasm32"))]
fn model_endings() -> Vec<&'static str> {
    let of_gaussians = Format::ALL.into_iter().filter_map(|format| format.ending().rsplit('.').next());
    let mut endings: Vec<_> = std::iter::once("ibgs").chain(of_gaussians).collect();
    // Both kinds of PLY have the same.
    endings.dedup();
    endings
}

/// The system's own dialog.
#[cfg(not(target_arch = "wasm32"))]
fn native(sought: Sought) -> Option<PathBuf> {
    let dialog = rfd::FileDialog::new();
    match sought {
        Sought::ModelFolder => dialog.set_title("Open a model folder").pick_folder(),
        Sought::ModelFile => dialog
            .set_title("Open a bundle or a file of Gaussians")
            .add_filter("Models", &model_endings())
            .add_filter("All files", &["*"])
            .pick_file(),
        Sought::Scene => dialog.set_title("Choose a scene folder").pick_folder(),
        Sought::Photos => dialog.set_title("Choose a folder of photos").pick_folder(),
        Sought::Video => dialog.set_title("Choose a video").pick_file(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    fn answered(dialog: &mut Dialog) -> Option<Answer> {
        let start = Instant::now();
        loop {
            let answer = dialog.answer();
            if answer.is_some() || !dialog.is_open() {
                return answer;
            }
            assert!(start.elapsed() < Duration::from_secs(60));
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn a_choice_is_returned_once_and_a_cancelled_dialog_returns_nothing() {
        let window = Context::default();
        let mut dialog = Dialog::new(|_| Some("scene".into()));
        assert_eq!(dialog.answer(), None);
        dialog.open(Sought::Scene, &window);
        assert_eq!(answered(&mut dialog), Some(Answer::Chosen(Sought::Scene, "scene".into())));
        assert_eq!((dialog.answer(), dialog.is_open()), (None, false));
        let mut cancelled = Dialog::new(|_| {
            std::thread::sleep(2 * UNSEEN);
            None
        });
        cancelled.open(Sought::ModelFile, &window);
        assert_eq!((answered(&mut cancelled), cancelled.is_open()), (None, false));
    }

    #[test]
    fn a_dialog_that_nobody_saw_is_said_to_be_none() {
        for mut dialog in [Dialog::new(|_| None), Dialog::new(|_| panic!("a dialog that fails"))] {
            dialog.open(Sought::ModelFile, &Context::default());
            assert_eq!((answered(&mut dialog), dialog.is_open()), (Some(Answer::NoDialog), false));
        }
    }

    #[test]
    fn one_dialog_at_a_time() {
        let window = Context::default();
        let (go, wait) = channel::<()>();
        let wait = Mutex::new(wait);
        let mut dialog = Dialog::new(move |_| wait.lock().ok()?.recv().ok().map(|()| "first".into()));
        dialog.open(Sought::Scene, &window);
        dialog.open(Sought::ModelFile, &window);
        assert_eq!((dialog.answer(), dialog.is_open()), (None, true));
        go.send(()).unwrap();
        assert_eq!(answered(&mut dialog), Some(Answer::Chosen(Sought::Scene, "first".into())));
    }
}
