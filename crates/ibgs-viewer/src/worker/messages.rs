//! What the window and the worker send each other.

use crate::edit_work::{EditCommand, EditMessage};
use crate::film::Film;
use crate::looks::Look;
use crate::mode::{Mode, Style};
use crate::preparing::Sign;
use crate::{OpenRequest, Opened, PhotosRequest, Scene, ShareRequest};
use eframe::egui::Context;
use ibgs_core::camera::Camera;
use ibgs_core::camera_path::Keyframe;
use ibgs_core::inspect::Inspection;
use ibgs_core::output::log::TrainingProgress;
use ibgs_core::render::Frame;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::Sender;
use std::time::Duration;

/// The way of messages to the window, from the worker and the threads beside it.
#[derive(Clone)]
pub struct Post {
    /// Where they go.
    pub messages: Sender<Message>,
    /// The window.
    pub window: Context,
}

impl Post {
    /// Sends a message, and wakes the window.
    pub fn send(&self, message: Message) {
        // The receiver is gone once the window is closed.
        let _ = self.messages.send(message);
        self.window.request_repaint();
    }
}

/// A frame that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// From where.
    pub camera: Camera,
    /// Find the usual range of its depths as well.
    pub with_range: bool,
    /// Render these looks beside the image.
    pub looks: [bool; Look::ALL.len()],
    /// The colour behind the Gaussians; none: that of the model.
    pub background: Option<[f32; 3]>,
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

/// A keyframe of the camera path whose picture is asked for.
#[derive(Clone, Copy, Debug)]
pub struct KeyframeRequest {
    /// The keyframe.
    pub key: Keyframe,
    /// From where.
    pub camera: Camera,
    /// What is shown.
    pub mode: Mode,
    /// How.
    pub style: Style,
}

/// What the window asks for.
pub enum Command {
    /// Open something in place of what is open.
    Open(OpenRequest),
    /// Make a scene of photos.
    Prepare(Box<PhotosRequest>),
    /// Write a model for others.
    Share(Box<ShareRequest>),
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
    /// End the training before its time, and save its results.
    End,
    /// Save the model now.
    Save,
    /// Render a film.
    Film(Box<Film>),
    /// Leave the film unfinished.
    CancelFilm,
    /// Render what a keyframe shows.
    Keyframe(Box<KeyframeRequest>),
    /// What the editor asks for.
    Edit(EditCommand),
}

/// What a model has, as a frame found it.
#[derive(Clone, Debug)]
pub struct ModelFacts {
    /// Number of Gaussians, of all bases; of a model with levels of detail those that the frame is made of.
    pub gaussians: usize,
    /// Finer chunks of such a model are still to come.
    pub is_loading: bool,
    /// Cameras of the source photos; none without a residual network.
    pub sources: Option<Arc<[Camera]>>,
    /// Most sources that a pixel can use.
    pub most_sources: u32,
    /// Most sources that a pixel of this frame sees; none without a residual network.
    pub most_seen: Option<u32>,
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
    /// The colour that was asked for behind the Gaussians.
    pub background: Option<[f32; 3]>,
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
    /// What was to be opened are photos without poses, or a video.
    Photos(PathBuf),
    /// How a preparation goes.
    Preparing(Sign),
    /// A model was written for others: what to tell of it, or why it was not.
    Shared(Result<Vec<String>, String>),
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
    /// The training has ended.
    Ended {
        /// Its results are saved; otherwise it failed.
        saved: bool,
    },
    /// The model was saved.
    Saved(PathBuf),
    /// Frames of the film that are done.
    Filmed(usize),
    /// The film has ended: what was written, where nothing failed.
    FilmDone(Option<String>),
    /// What a keyframe shows, RGB; none where it cannot be rendered.
    Keyframe(Box<KeyframeRequest>, Option<Vec<u8>>),
    /// Something failed, in one sentence.
    Failed(String),
    /// The frame that was asked for could not be rendered.
    NoFrame,
    /// The device has no room for it, in one sentence.
    NoRoom(String),
    /// What the editor is sent.
    Edit(EditMessage),
}
