//! What opens, renders and trains beside the window: a thread, in a browser a task. The window sends [`Command`]s and receives
//! [`Message`]s; it never waits.

mod film;
mod frame;
mod messages;
mod training;

pub use messages::{Command, KeyframeRequest, Message, ModelFacts, Post, Rendered, Request, Sheet};

use crate::edit_work::{EditWork, EditedRenderers};
use crate::film::Shoot;
use crate::looks::Looks;
use crate::preparing::{Sign, Watch};
use crate::{Content, Open, OpenRequest, Opened, Outcome, PhotosRequest, ShareRequest, Training};
use eframe::egui;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::present::Presenter;
use ibgs_core::render::Renderer;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Mutex, PoisonError};
use std::thread::JoinHandle;
use web_time::Instant;

/// The window's end.
pub struct Worker {
    commands: async_channel::Sender<Command>,
    /// Messages from the worker.
    pub messages: Receiver<Message>,
    /// A preparation is to stop.
    stop: Arc<AtomicBool>,
    #[cfg(not(target_arch = "wasm32"))]
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the worker; it wakes the window at each message.
    pub fn start(gpu: Arc<Gpu>, opener: impl Open, opened: Option<Opened>, window: egui::Context) -> Self {
        let (commands, received) = async_channel::unbounded();
        let (sender, messages) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let (opener, aside) = (Arc::new(opener), Mutex::default());
        let post = Post { messages: sender, window };
        let state = WorkerState { gpu, opener, post, stop: stop.clone(), aside };
        #[cfg(target_arch = "wasm32")]
        {
            wasm_bindgen_futures::spawn_local(state.work(received, opened));
            Self { commands, messages, stop }
        }
        #[cfg(not(target_arch = "wasm32"))]
        {
            let thread = std::thread::Builder::new().name("viewer worker".to_owned());
            let thread = thread.spawn(move || pollster::block_on(state.work(received, opened)));
            Self { commands, messages, stop, thread: Some(thread.expect("a thread can be started")) }
        }
    }

    /// Asks for something. False when the worker is gone.
    pub fn send(&self, command: Command) -> bool {
        self.commands.try_send(command).is_ok()
    }

    /// Stops a preparation, or allows the next one.
    pub fn stop_preparing(&self, stop: bool) {
        self.stop.store(stop, Ordering::Relaxed);
    }
}

impl Drop for Worker {
    /// Waits until a training is saved; a preparation stops.
    fn drop(&mut self) {
        self.stop_preparing(true);
        self.commands.close();
        #[cfg(not(target_arch = "wasm32"))]
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// What the worker owns as long as it runs.
struct WorkerState {
    gpu: Arc<Gpu>,
    opener: Arc<dyn Open>,
    post: Post,
    stop: Arc<AtomicBool>,
    /// Threads that make scenes of photos and write models for others.
    aside: Mutex<Vec<JoinHandle<()>>>,
}

#[derive(Default)]
struct Work {
    content: Option<Content>,
    /// The training continues.
    running: bool,
    /// One iteration and no more.
    single: bool,
    /// `finish` has not been called yet.
    unfinished: bool,
    request: Option<(Box<Request>, Option<Sheet>)>,
    presenter: Option<Presenter>,
    looks: Looks,
    edit: EditWork,
    /// The colour behind the Gaussians that the window asks for, and the model's own.
    background: Option<[f32; 3]>,
    own_background: [f32; 3],
    /// The model with what is selected tinted, for the window alone.
    tinted: Option<Arc<Renderer>>,
    film: Option<Shoot>,
    reported: Option<Instant>,
    memory: Option<(Instant, Option<u64>)>,
}

impl Work {
    /// The work on what was opened.
    fn of(content: Content) -> Self {
        let own_background = match &content {
            Content::Model(renderer) => renderer.background(),
            // Its renderers are made with it.
            Content::Training(_) => [0.0; 3],
        };
        Self { content: Some(content), own_background, ..Self::default() }
    }

    fn is_idle(&self) -> bool {
        self.request.is_none() && self.film.is_none() && self.edit.is_idle() && !self.running && !self.single
    }

    fn training(&mut self) -> Option<&mut Box<dyn Training>> {
        match &mut self.content {
            Some(Content::Training(training)) => Some(training),
            _ => None,
        }
    }

    /// A renderer of the model as it is, and the iteration.
    fn renderer(&self) -> Option<(Arc<Renderer>, u32)> {
        match &self.content {
            Some(Content::Model(renderer)) => {
                renderer.set_background(self.background.unwrap_or(self.own_background));
                Some((renderer.clone(), self.edit.revision))
            }
            Some(Content::Training(training)) => {
                let renderer = training.renderer().ok()?;
                self.background.into_iter().for_each(|color| renderer.set_background(color));
                Some((Arc::new(renderer), training.progress().iteration))
            }
            None => None,
        }
    }

    /// The same as the window shows it.
    fn shown(&self) -> Option<(Arc<Renderer>, u32)> {
        match &self.tinted {
            Some(tinted) => {
                tinted.set_background(self.background.unwrap_or(self.own_background));
                Some((tinted.clone(), self.edit.revision))
            }
            None => self.renderer(),
        }
    }
}

impl WorkerState {
    fn send(&self, message: Message) {
        self.post.send(message);
    }

    fn status(&self, what: &str) {
        self.send(Message::Doing(what.to_owned()));
    }

    fn failed(&self, error: &anyhow::Error) {
        self.send(Message::Failed(self.opener.sentence(error)));
    }

    /// Reports an error; where the device has failed, a training saves what it has first.
    fn failed_in(&self, work: &mut Work, error: &anyhow::Error) {
        let lost = matches!(error.downcast_ref(), Some(GpuError::Readback(_) | GpuError::Failed(_)));
        match lost && work.unfinished {
            true => self.train(work),
            false => self.failed(error),
        }
    }

    /// Reports why a frame could not be rendered.
    fn no_frame(&self, work: &mut Work, error: &anyhow::Error) {
        match error.downcast_ref() {
            Some(GpuError::TooLarge { .. } | GpuError::OutOfMemory { .. }) => {
                self.send(Message::NoRoom(self.opener.sentence(error)));
            }
            _ => {
                self.send(Message::NoFrame);
                self.failed_in(work, error);
            }
        }
    }

    async fn work(self, commands: async_channel::Receiver<Command>, opened: Option<Opened>) {
        let mut work = Work::default();
        if let Some(opened) = opened {
            self.take(&mut work, opened);
        }
        loop {
            if work.is_idle() {
                match commands.recv().await {
                    Ok(command) => self.execute(&mut work, command).await,
                    Err(_) => break,
                }
            }
            while let Ok(command) = commands.try_recv() {
                self.execute(&mut work, command).await;
            }
            if commands.is_closed() {
                break;
            }
            self.edited(&mut work);
            if let Some((request, sheet)) = work.request.take()
                && let Err(error) = self.render(&mut work, &request, sheet.as_ref()).await
            {
                self.no_frame(&mut work, &error);
            }
            self.shoot(&mut work);
            self.compare(&mut work);
            if work.running || work.single {
                self.train(&mut work);
            }
        }
        self.end(&mut work);
        for thread in self.aside.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
            let _ = thread.join();
        }
    }

    fn take(&self, work: &mut Work, opened: Opened) {
        let progress = match &opened.content {
            Content::Training(training) => Some(training.progress()),
            Content::Model(_) => None,
        };
        let running = progress.is_some();
        *work = Work { running, unfinished: running, ..Work::of(opened.content) };
        self.send(Message::Opened(Box::new(opened.scene), progress));
    }

    fn open(&self, work: &mut Work, wanted: &OpenRequest) {
        self.status("opening");
        let post = &self.post;
        let status = |what: &str| post.send(Message::Doing(what.to_owned()));
        match self.opener.open(wanted, &self.gpu, &status) {
            Ok(Outcome::Opened(opened)) => {
                self.end(work);
                self.take(work, *opened);
            }
            Ok(Outcome::Scene(path)) => self.send(Message::Scene(path)),
            Ok(Outcome::Photos(path)) => self.send(Message::Photos(path)),
            Err(error) => self.failed(&error),
        }
    }

    async fn execute(&self, work: &mut Work, command: Command) {
        match command {
            Command::Open(wanted) => self.open(work, &wanted),
            Command::Prepare(wanted) => self.prepare(*wanted),
            Command::Share(wanted) => self.share(*wanted),
            Command::Replace(opened, revision) => {
                let edit = EditWork::of_revision(revision);
                let (request, film) = (work.request.take(), work.film.take());
                *work = Work { edit, request, film, ..Work::of(opened.content) };
                self.send(Message::Replaced(Box::new(opened.scene), revision));
            }
            Command::Render(request, sheet) => work.request = Some((request, sheet)),
            Command::Inspect { frame, pixel, focus } => match frame.inspect_async(pixel[0], pixel[1]).await {
                Ok(Some(found)) => self.send(Message::Inspected { found: Box::new(found), focus }),
                Ok(None) => {}
                Err(error) => self.failed_in(work, &error.into()),
            },
            Command::Run(on) => {
                work.running = on && work.unfinished;
                self.report(work, true);
            }
            Command::Step => (work.running, work.single) = (false, work.unfinished),
            Command::End => self.finish(work),
            Command::Save => {
                if let Some(training) = work.training() {
                    match training.save() {
                        Ok(Some(path)) => self.send(Message::Saved(path)),
                        Ok(None) => {}
                        Err(error) => self.failed(&error),
                    }
                }
            }
            Command::Film(film) => match Shoot::begin(&self.gpu, *film) {
                Ok(shoot) => work.film = Some(shoot),
                Err(error) => self.film_failed(&error),
            },
            Command::CancelFilm => {
                if let Some(shoot) = work.film.take() {
                    self.send(Message::FilmDone(Some(shoot.cancelled())));
                }
            }
            Command::Keyframe(wanted) => self.picture_keyframe(work, *wanted),
            Command::Edit(command) => match work.edit.execute(work.content.as_ref(), command) {
                Ok(Some(message)) => self.send(Message::Edit(message)),
                Ok(None) => {}
                Err(error) => self.failed(&error),
            },
        }
    }

    /// Makes a scene of photos, on a thread of its own.
    fn prepare(&self, wanted: PhotosRequest) {
        let watch = Watch::new(self.post.clone(), self.stop.clone());
        let opener = self.opener.clone();
        let failed = |sentence| Message::Preparing(Sign::Failed(sentence));
        self.beside(failed, move || {
            Message::Preparing(match opener.prepare(&wanted, &watch) {
                Ok(scene) => Sign::Made(scene),
                Err(_) if watch.is_stopped() => Sign::Stopped,
                Err(error) => Sign::Failed(opener.sentence(&error)),
            })
        });
    }

    /// Writes a model for others, on a thread of its own.
    fn share(&self, wanted: ShareRequest) {
        let opener = self.opener.clone();
        let failed = |sentence| Message::Shared(Err(sentence));
        self.beside(failed, move || Message::Shared(opener.share(&wanted).map_err(|error| opener.sentence(&error))));
    }

    /// Does work on a thread of its own, which the end of the window waits for, and sends its message, or that it `failed`.
    fn beside(&self, failed: fn(String) -> Message, work: impl FnOnce() -> Message + Send + 'static) {
        let post = self.post.clone();
        let work = move || {
            let done = catch_unwind(AssertUnwindSafe(work));
            post.send(done.unwrap_or_else(|_| failed("it failed by a mistake of this program".to_owned())));
        };
        match std::thread::Builder::new().name("beside the window".to_owned()).spawn(work) {
            Ok(thread) => self.aside.lock().unwrap_or_else(PoisonError::into_inner).push(thread),
            Err(error) => self.send(failed(format!("no thread can be started: {error}"))),
        }
    }

    /// Puts what an edited model still has on the device.
    fn edited(&self, work: &mut Work) {
        match work.edit.renderers(work.content.as_ref()) {
            Ok(Some(EditedRenderers { plain, tinted })) => {
                work.content = plain.map(|plain| Content::Model(Arc::new(plain))).or(work.content.take());
                (work.tinted, work.looks) = (tinted.map(Arc::new), Looks::default());
            }
            Ok(None) => {}
            Err(error) => self.failed(&error),
        }
    }

    /// Compares an edited model with the next photo.
    fn compare(&self, work: &mut Work) {
        if work.edit.is_idle() {
            return;
        }
        if let Err(error) = work.edit.compare(work.content.as_ref(), work.own_background) {
            self.failed_in(work, &error);
        }
        self.post.window.request_repaint();
    }
}
