//! What opens, renders and trains beside the window: a thread, in a browser a task. The window sends [`Command`]s and receives
//! [`Message`]s; it never waits.

use crate::edit_work::{EditCommand, EditMessage, EditWork};
use crate::film::{Film, Shoot};
use crate::looks::{Look, Looks, rendered};
use crate::mode::{Mode, Style};
use crate::{Content, Open, Opened, Outcome, Scene, Training, Wanted};
use anyhow::Result;
use eframe::egui;
use ibgs_core::camera::Camera;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::inspect::Inspection;
use ibgs_core::levels::Stream;
use ibgs_core::output::log::TrainingProgress;
use ibgs_core::picture::usual_range;
use ibgs_core::present::Presenter;
use ibgs_core::render::{Frame, Renderer};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
#[cfg(not(target_arch = "wasm32"))]
use std::thread::JoinHandle;
use std::time::Duration;
use web_time::Instant;

/// Least time between two reports of a training.
const REPORT: Duration = Duration::from_millis(100);
/// Least time between two readings of the memory in use.
const MEMORY: Duration = Duration::from_secs(1);

/// A frame that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// From where.
    pub camera: Camera,
    /// Find the usual range of its depths as well.
    pub with_range: bool,
    /// Render these looks beside the image.
    pub looks: [bool; Look::ALL.len()],
}

/// Where a frame's picture goes.
#[derive(Clone, Debug)]
pub struct Sheet {
    /// A texture of the frame's size that the window does not paint now.
    pub texture: wgpu::Texture,
    /// What it is to show; nothing that needs a photo.
    pub mode: Mode,
    /// How.
    pub style: Style,
}

/// What the window asks for.
pub enum Command {
    /// Open something in place of what is open.
    Open(Wanted),
    /// Show another model of the same scene, as this revision.
    Replace(Box<Opened>, u32),
    /// Render a view; of several the last one counts.
    Render(Box<Request>, Option<Sheet>),
    /// Explain why a pixel of a frame looks as it does.
    Inspect {
        /// The frame.
        frame: Arc<Frame>,
        /// The pixel.
        pixel: [u32; 2],
        /// Turn the camera to the pixel's surface point.
        focus: bool,
    },
    /// Continue the training, or pause it.
    Run(bool),
    /// One iteration, then pause.
    Step,
    /// Save the model now.
    Save,
    /// Render a film.
    Film(Box<Film>),
    /// Leave the film unfinished.
    CancelFilm,
    /// What the editor asks for.
    Edit(EditCommand),
}

/// What a model has, as a frame found it.
#[derive(Clone, Debug)]
pub struct ModelFacts {
    /// Number of Gaussians; of a model with levels of detail those that the frame is made of.
    pub gaussians: usize,
    /// Finer chunks of such a model are still to come.
    pub is_loading: bool,
    /// Cameras of the source photos; none without a residual network.
    pub sources: Option<Arc<[Camera]>>,
    /// Most sources that a pixel uses.
    pub most_sources: u32,
}

/// A finished frame.
pub struct Rendered {
    /// The frame.
    pub frame: Arc<Frame>,
    /// The usual range of its depths, where it was asked for.
    pub range: Option<[f32; 2]>,
    /// Its median depths, where their range was asked for.
    pub depths: Option<Arc<[f32]>>,
    /// The same view in other looks, where they were asked for.
    pub looks: [Option<Arc<Frame>>; Look::ALL.len()],
    /// From the request to the end of the GPU's work.
    pub time: Duration,
    /// What the model has.
    pub facts: ModelFacts,
    /// Device memory in use, where the driver reports it.
    pub memory: Option<u64>,
    /// Iteration of the training, or revision of an edited model.
    pub iteration: u32,
}

/// What the worker sends to the window.
pub enum Message {
    /// What is being done.
    Doing(String),
    /// Something was opened; with how far it is where it is a training.
    Opened(Box<Scene>, Option<TrainingProgress>),
    /// Another model of the same scene is in place of the one before, as this revision.
    Replaced(Box<Scene>, u32),
    /// What was to be opened is a scene.
    Scene(PathBuf),
    /// A finished frame.
    Rendered(Box<Rendered>),
    /// Why a pixel looks as it does.
    Inspected {
        /// What was found.
        found: Box<Inspection>,
        /// Turn the camera to the surface point.
        focus: bool,
    },
    /// How far the training is; with whether it continues.
    Progress(Box<TrainingProgress>, bool),
    /// The model was saved.
    Saved(PathBuf),
    /// Frames of the film that are done, and their number.
    Filmed(usize, usize),
    /// The film has ended: what was written, where nothing failed.
    FilmDone(Option<String>),
    /// Something failed, in one sentence.
    Failed(String),
    /// The frame that was asked for could not be rendered.
    NoFrame,
    /// What the editor is sent.
    Edit(EditMessage),
}

/// The window's end.
pub struct Worker {
    commands: async_channel::Sender<Command>,
    /// Messages from the worker.
    pub messages: Receiver<Message>,
    #[cfg(not(target_arch = "wasm32"))]
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the worker; it wakes the window at each message.
    pub fn start(gpu: Arc<Gpu>, opener: impl Open, opened: Option<Opened>, window: egui::Context) -> Self {
        let (commands, received) = async_channel::unbounded();
        let (sender, messages) = channel();
        let state = State { gpu, opener: Box::new(opener), messages: sender, window };
        #[cfg(target_arch = "wasm32")]
        {
            wasm_bindgen_futures::spawn_local(state.work(received, opened));
            Self { commands, messages }
        }
        #[cfg(not(target_arch = "wasm32"))]
        {
            let thread = std::thread::Builder::new().name("viewer worker".to_owned());
            let thread = thread.spawn(move || pollster::block_on(state.work(received, opened)));
            Self { commands, messages, thread: Some(thread.expect("a thread can be started")) }
        }
    }

    /// Asks for something. False when the worker is gone.
    pub fn send(&self, command: Command) -> bool {
        self.commands.try_send(command).is_ok()
    }
}

impl Drop for Worker {
    /// Waits until a training is saved.
    fn drop(&mut self) {
        self.commands.close();
        #[cfg(not(target_arch = "wasm32"))]
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// What the worker owns as long as it runs.
struct State {
    gpu: Arc<Gpu>,
    opener: Box<dyn Open>,
    messages: Sender<Message>,
    window: egui::Context,
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
    film: Option<Shoot>,
    reported: Option<Instant>,
    memory: Option<(Instant, Option<u64>)>,
}

impl Work {
    fn is_idle(&self) -> bool {
        self.request.is_none() && self.film.is_none() && !self.running && !self.single
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
            Some(Content::Model(renderer)) => Some((renderer.clone(), self.edit.revision)),
            Some(Content::Training(training)) => {
                Some((Arc::new(training.renderer().ok()?), training.progress().iteration))
            }
            None => None,
        }
    }
}

impl State {
    fn send(&self, message: Message) {
        // The receiver is gone once the window is closed.
        let _ = self.messages.send(message);
        self.window.request_repaint();
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
                self.send(Message::NoFrame);
                self.failed_in(&mut work, &error);
            }
            self.shoot(&mut work);
            if work.running || work.single {
                self.train(&mut work);
            }
        }
        self.end(&mut work);
    }

    /// Ends a training that is still open.
    fn end(&self, work: &mut Work) {
        if std::mem::take(&mut work.unfinished)
            && let Some(training) = work.training()
        {
            log::info!("stopped at iteration {}: saving and measuring", training.progress().iteration);
            if let Err(error) = training.finish() {
                self.failed(&error);
            }
        }
        work.content = None;
    }

    fn take(&self, work: &mut Work, opened: Opened) {
        let progress = match &opened.content {
            Content::Training(training) => Some(training.progress()),
            Content::Model(_) => None,
        };
        *work = Work { running: progress.is_some(), unfinished: progress.is_some(), ..Work::default() };
        work.content = Some(opened.content);
        self.send(Message::Opened(Box::new(opened.scene), progress));
    }

    async fn execute(&self, work: &mut Work, command: Command) {
        match command {
            Command::Open(wanted) => {
                self.status("opening");
                match self.opener.open(&wanted, &self.gpu, &|what| self.status(what)) {
                    Ok(Outcome::Opened(opened)) => {
                        self.end(work);
                        self.take(work, *opened);
                    }
                    Ok(Outcome::Scene(path)) => self.send(Message::Scene(path)),
                    Err(error) => self.failed(&error),
                }
            }
            Command::Replace(opened, revision) => {
                let edit = EditWork::of_revision(revision);
                *work = Work { content: Some(opened.content), edit, request: work.request.take(), ..Work::default() };
                self.send(Message::Replaced(Box::new(opened.scene), revision));
            }
            Command::Render(request, sheet) => work.request = Some((request, sheet)),
            Command::Inspect { frame, pixel, focus } => match frame.inspect_later(pixel[0], pixel[1]).await {
                Ok(Some(found)) => self.send(Message::Inspected { found: Box::new(found), focus }),
                Ok(None) => {}
                Err(error) => self.failed_in(work, &error.into()),
            },
            Command::Run(on) => {
                work.running = on && work.unfinished;
                self.report(work, true);
            }
            Command::Step => (work.running, work.single) = (false, work.unfinished),
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
                Err(error) => self.failed(&error),
            },
            Command::CancelFilm => {
                if let Some(shoot) = work.film.take() {
                    self.send(Message::FilmDone(Some(shoot.cancelled())));
                }
            }
            Command::Edit(command) => match work.edit.execute(work.content.as_ref(), command) {
                Ok(Some(message)) => self.send(Message::Edit(message)),
                Ok(None) => {}
                Err(error) => self.failed(&error),
            },
        }
    }

    /// Puts what an edited model still has on the device.
    fn edited(&self, work: &mut Work) {
        match work.edit.renderer(work.content.as_ref()) {
            Ok(Some(renderer)) => {
                (work.content, work.looks) = (Some(Content::Model(Arc::new(renderer))), Looks::default())
            }
            Ok(None) => {}
            Err(error) => self.failed(&error),
        }
    }

    async fn render(&self, work: &mut Work, request: &Request, sheet: Option<&Sheet>) -> Result<()> {
        if work.unfinished {
            // Pending work of a training would count towards the frame's time.
            self.gpu.wait()?;
        }
        let Some((renderer, iteration)) = work.renderer() else { return Ok(()) };
        let start = Instant::now();
        let presenter = match &mut work.presenter {
            Some(presenter) => presenter,
            none => none.insert(Presenter::new(self.gpu.clone())?),
        };
        let mut present = |frame: &Frame, look: Option<Look>| match sheet.filter(|sheet| sheet.mode.look() == look) {
            Some(sheet) => presenter.present(frame, &sheet.mode.shown(&sheet.style, None), &sheet.texture),
            None => Ok(()),
        };
        // Those of a training are of this iteration alone.
        let mut passing = Looks::default();
        let looks = match work.content {
            Some(Content::Model(_)) => &mut work.looks,
            _ => &mut passing,
        };
        // It has waited for the device's answer.
        let frame = rendered(&renderer, &request.camera, |frame| present(frame, None)).await?;
        let looks = looks.frames(&renderer, request, |frame, look| present(frame, Some(look))).await?;
        let time = start.elapsed();
        let depths = if request.with_range { frame.depth_later().await? } else { None };
        let facts = ModelFacts {
            gaussians: renderer.stream().map_or(renderer.splats().len(), Stream::shown),
            is_loading: renderer.stream().is_some_and(Stream::is_waiting),
            sources: renderer.part().map(|part| part.cameras.clone()),
            most_sources: renderer.part().map_or(1, |part| part.options.sources.visible),
        };
        let range = depths.as_ref().map(|depths| usual_range(depths));
        let (frame, depths, memory) = (Arc::new(frame), depths.map(Arc::from), self.memory(work));
        let whole = Rendered { frame, range, depths, looks, time, facts, memory, iteration };
        self.send(Message::Rendered(Box::new(whole)));
        Ok(())
    }

    /// Device memory in use; asked for now and then, as the answer lists every buffer.
    fn memory(&self, work: &mut Work) -> Option<u64> {
        if work.memory.is_none_or(|(at, _)| at.elapsed() > MEMORY) {
            work.memory = Some((Instant::now(), self.gpu.memory_report().map(|report| report.reserved_bytes)));
        }
        work.memory.and_then(|(_, bytes)| bytes)
    }

    /// The next frame of a film.
    fn shoot(&self, work: &mut Work) {
        let Some(mut shoot) = work.film.take() else { return };
        match work.renderer().map(|(renderer, _)| shoot.next(&renderer)) {
            Some(Ok(None)) => {
                self.send(Message::Filmed(shoot.done(), shoot.count()));
                work.film = Some(shoot);
            }
            Some(Ok(written)) => self.send(Message::FilmDone(written)),
            Some(Err(error)) => {
                self.send(Message::FilmDone(None));
                self.failed(&error);
            }
            None => {}
        }
    }

    fn train(&self, work: &mut Work) {
        work.single = false;
        let Some(training) = work.training() else { return };
        let stepped = training.step(&|what| self.status(what));
        let progress = training.progress();
        match stepped {
            Ok(()) if progress.iteration >= progress.iterations => {
                let finished = training.finish();
                (work.running, work.unfinished) = (false, false);
                match finished {
                    Ok(()) => self.report(work, true),
                    Err(error) => self.failed(&error),
                }
            }
            Ok(()) => self.report(work, !work.running),
            Err(error) => {
                // The training cannot continue. Its model has been saved if that was possible.
                (work.running, work.unfinished) = (false, false);
                self.report(work, true);
                self.failed(&error);
            }
        }
    }

    /// Reports how far the training is, now or when it is time.
    fn report(&self, work: &mut Work, now: bool) {
        let due = work.reported.is_none_or(|at| at.elapsed() >= REPORT);
        let running = work.running;
        if (now || due)
            && let Some(training) = work.training()
        {
            let progress = Box::new(training.progress());
            work.reported = Some(Instant::now());
            self.send(Message::Progress(progress, running));
        }
    }
}
