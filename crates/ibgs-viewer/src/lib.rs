//! The interactive viewer: a window on a model, drawn on the device that renders it.
//!
//! [`Viewer`] is the window: `viewer` has its state, `panels` and `marks` draw it, `app` puts them together. A thread of its own, in a browser a task, renders and trains
//! ([`worker`]), so the window answers while it works. [`canvas`] puts finished frames on the screen, [`navigator`] moves the camera.

#![forbid(unsafe_code)]

mod app;
pub mod canvas;
mod curves;
mod dialogs;
mod edit;
mod edit_work;
mod film;
mod icons;
mod keys;
mod looks;
mod marks;
pub mod measure;
pub mod mode;
pub mod navigator;
mod panels;
mod path_editor;
mod photos_form;
mod preparing;
mod recents;
mod settings;
mod share;
mod start_page;
mod theme;
mod thumbnails;
mod train_form;
mod viewer;
pub mod worker;

pub use mode::Mode;
pub use photos_form::NEXT as NEXT_OF_PHOTOS;
pub use preparing::{PhotosRequest, Watch};
pub use share::{ShareKind, ShareRequest};
pub use viewer::Viewer;

#[cfg(target_arch = "wasm32")]
pub use eframe::WebRunner;

use anyhow::{Result, bail};
use eframe::egui;
use eframe::egui_wgpu::{WgpuConfiguration, WgpuSetup, WgpuSetupExisting};
use ibgs_core::camera::Camera;
use ibgs_core::config::{ExposureSwitch, Method, Preset, TrainConfig};
use ibgs_core::dataset::{self, Dataset, HostPhoto, Masks, Point, Resolution};
use ibgs_core::gpu::Gpu;
use ibgs_core::model::Model;
use ibgs_core::output::cameras::{CameraRecord, Split};
use ibgs_core::output::log::TrainingProgress;
use ibgs_core::render::Renderer;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

/// A view of the scene that the camera can stand on.
#[derive(Clone, Debug)]
pub struct View {
    /// Name of its photo.
    pub name: String,
    /// Its camera.
    pub camera: Camera,
    /// The model was not trained on it.
    pub held_out: bool,
    /// Its photo, of the camera's size.
    pub photo: Option<HostPhoto>,
}

impl View {
    /// A view of a model, with its photo where there is one of its size under its name.
    pub fn of(record: &CameraRecord, photos: &HashMap<String, HostPhoto>) -> View {
        let size = [record.camera.width, record.camera.height];
        let photo = photos.get(&record.name).filter(|photo| photo.size() == size);
        View {
            name: record.name.clone(),
            camera: record.camera,
            held_out: record.split == Some(Split::Test),
            photo: photo.cloned(),
        }
    }

    /// The views of a scene.
    pub fn all(dataset: &Dataset) -> Vec<View> {
        let view = |(index, view): (usize, &dataset::View)| View {
            name: view.name.clone(),
            camera: view.camera,
            held_out: dataset.test.contains(&index),
            photo: Some(view.photo.clone()),
        };
        dataset.views.iter().enumerate().map(view).collect()
    }
}

/// What stands around a model.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Stands in the window's title.
    pub title: String,
    /// What to open to see it again; none for what is built in.
    pub path: Option<PathBuf>,
    /// The views of its scene.
    pub views: Vec<View>,
    /// Sparse points of the scene.
    pub points: Vec<Point>,
    /// Where screenshots and films go.
    pub pictures: PathBuf,
    /// The model without its Gaussians, which a bundle needs; none where there is no more than Gaussians.
    pub model: Option<Arc<Model>>,
    /// What the user should know of it.
    pub note: Option<String>,
}

impl Scene {
    /// The first view with a photo. Without any, as in a bundle that still loads, the first one that the model was trained on.
    fn first_view(&self) -> Option<usize> {
        let first = |wanted: fn(&View) -> bool| self.views.iter().position(wanted);
        first(|view| view.photo.is_some()).or_else(|| first(|view| !view.held_out)).or_else(|| first(|_| true))
    }
}

/// What is looked at.
pub enum Content {
    /// A finished model; it finds the surface of every frame.
    Model(Arc<Renderer>),
    /// A model that is being trained.
    Training(Box<dyn Training>),
}

/// Something that was opened.
pub struct Opened {
    /// What stands around it.
    pub scene: Scene,
    /// What is looked at.
    pub content: Content,
}

/// What a user may ask to open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OpenRequest {
    /// A model folder, a bundle, a file of Gaussians, a scene, or photos without poses.
    Path(PathBuf),
    /// A training, which begins at once.
    Train(TrainingRequest),
}

/// A training as the start page describes it; all else is at its default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrainingRequest {
    /// Scene folder or a ZIP archive of one; none: the built-in demo scene.
    pub scene: Option<PathBuf>,
    /// The options to begin with.
    pub preset: Preset,
    /// What is trained.
    pub method: Method,
    /// Number of iterations; none: that of the preset, otherwise by the photos, in the demo scene that of [`Open::demo_iterations`].
    pub iterations: Option<u32>,
    /// Whether the photos' exposures are corrected.
    pub exposure: ExposureSwitch,
    /// Whether every 8th photo of a scene is held out, to measure on.
    pub eval: bool,
    /// Size of the photos.
    pub resolution: Resolution,
    /// Largest number of Gaussians; none: by the photos.
    pub max_splats: Option<u32>,
    /// What masked pixels mean; none: by the masks.
    pub masks: Option<Masks>,
    /// The model folder to write; none: a new one in `output`.
    pub model: Option<PathBuf>,
}

/// What a request leads to.
pub enum Outcome {
    /// Something to look at.
    Opened(Box<Opened>),
    /// A scene: the start page asks how to train on it.
    Scene(PathBuf),
    /// Photos or a video without poses: the start page asks how to make a scene of them.
    Photos(PathBuf),
}

/// Takes what is being done, in a few words, from any thread.
pub type Status<'a> = dyn Fn(&str) + Sync + 'a;

/// Opens what a user asks for; called on the viewer's own threads.
pub trait Open: Send + Sync + 'static {
    /// Opens it on this GPU. `status` is called with what is being done.
    ///
    /// # Errors
    /// A sentence that names the file and what to do.
    fn open(&self, wanted: &OpenRequest, gpu: &Arc<Gpu>, status: &Status<'_>) -> Result<Outcome>;

    /// Makes a scene of photos or a video and returns its folder; other things may be opened meanwhile. It ends early, with an
    /// error, once [`Watch::stop`] is true.
    ///
    /// # Errors
    /// A sentence that names what is missing and what to do.
    fn prepare(&self, _wanted: &PhotosRequest, _watch: &Watch) -> Result<PathBuf> {
        bail!("this window makes no scenes of photos");
    }

    /// Writes a model for others; returns what to tell of it, a line each. Other things may be opened meanwhile.
    ///
    /// # Errors
    /// A sentence that names the file and what to do.
    fn share(&self, _wanted: &ShareRequest) -> Result<Vec<String>> {
        bail!("this window writes no files");
    }

    /// Default number of iterations of the demo scene on this GPU.
    fn demo_iterations(&self, _gpu: &Gpu) -> u32 {
        TrainConfig::default().iterations()
    }

    /// An error in one line, with what the user can do about it where the program knows that.
    fn sentence(&self, error: &anyhow::Error) -> String {
        ibgs_core::sentence(error.as_ref())
    }
}

/// A running training.
pub trait Training: Send {
    /// One iteration, and what is due after it: saving and measuring, which are reported to `status`.
    ///
    /// # Errors
    /// The device failed, a file cannot be written, or a value is not finite.
    fn step(&mut self, status: &dyn Fn(&str)) -> Result<()>;

    /// How far it is.
    fn progress(&self) -> TrainingProgress;

    /// A renderer of the model as it is now, used before the next step; it finds the surface of every frame.
    fn renderer(&self) -> Result<Renderer>;

    /// Writes the model as it is now; returns where, none where the training writes no files.
    ///
    /// # Errors
    /// The device failed, or a file cannot be written.
    fn save(&mut self) -> Result<Option<PathBuf>>;

    /// Saves the results of the training. Called once: after the last iteration, or when the user stops it or closes the window
    /// before that. A closed window cannot show an error, so the implementation has to keep it.
    ///
    /// # Errors
    /// The device failed, or a file cannot be written.
    fn finish(&mut self) -> Result<()>;
}

/// The device of a GPU, for windows and tests.
pub fn wgpu_setup(gpu: &Gpu) -> WgpuSetup {
    WgpuSetup::Existing(WgpuSetupExisting {
        instance: gpu.instance.clone(),
        adapter: gpu.adapter.clone(),
        device: gpu.device.clone(),
        queue: gpu.queue.clone(),
    })
}

/// In a browser there is one model, no file and no training.
pub(crate) const IN_BROWSER: bool = cfg!(target_arch = "wasm32");

/// Closes the window, from any thread.
pub struct Closer(egui::Context);

impl Closer {
    /// Closes it as its user would: a training is saved, and unsaved edits are asked about.
    pub fn close(&self) {
        self.0.send_viewport_cmd(egui::ViewportCommand::Close);
        self.0.request_repaint();
    }
}

/// Shows what `first` says in a canvas of a page, until the page is left or the runner is destroyed.
///
/// # Errors
/// The canvas cannot be drawn into.
#[cfg(target_arch = "wasm32")]
pub async fn run_in(
    canvas: web_sys::HtmlCanvasElement,
    gpu: Arc<Gpu>,
    opener: impl Open,
    first: Option<Outcome>,
) -> Result<WebRunner, wasm_bindgen::JsValue> {
    let wgpu_options = WgpuConfiguration { wgpu_setup: wgpu_setup(&gpu), ..Default::default() };
    let options = eframe::WebOptions { wgpu_options, ..Default::default() };
    let make = move |cc: &eframe::CreationContext| Viewer::new(cc, gpu, opener, first);
    let runner = WebRunner::new();
    runner.start(canvas, options, Box::new(move |cc| Ok(Box::new(make(cc)?)))).await?;
    Ok(runner)
}

/// Opens a window, on what `first` says or on an empty start page, and returns when it is closed. `handed` receives a
/// [`Closer`] for it, and returns what is called where the user keeps the window open all the same.
///
/// # Errors
/// No display, or a device that cannot draw into windows.
#[cfg(not(target_arch = "wasm32"))]
pub fn run(
    gpu: &Arc<Gpu>,
    opener: impl Open,
    first: Option<Outcome>,
    handed: impl FnOnce(Closer) -> Box<dyn Fn() + Send>,
) -> Result<(), eframe::Error> {
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("ibgs")
            .with_app_id("ibgs")
            .with_inner_size([1280.0, 800.0])
            .with_min_inner_size([320.0, 240.0]),
        wgpu_options: WgpuConfiguration { wgpu_setup: wgpu_setup(gpu), ..Default::default() },
        ..Default::default()
    };
    let gpu = gpu.clone();
    let make = move |cc: &eframe::CreationContext| {
        let kept_open = handed(Closer(cc.egui_ctx.clone()));
        let mut viewer = Viewer::new(cc, gpu, opener, first)?;
        viewer.when_kept_open(kept_open);
        Ok::<_, ibgs_core::gpu::GpuError>(viewer)
    };
    eframe::run_native("ibgs", options, Box::new(move |cc| Ok(Box::new(make(cc)?))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::navigator::Navigator;
    use glam::DVec3;
    use ibgs_core::dataset::Photo;

    #[test]
    fn a_scene_begins_with_a_photo() {
        let camera = Navigator::facing(DVec3::ZERO, 1.0).camera(2, 1);
        let photo = || HostPhoto::from(Photo { width: 2, height: 1, rgba: vec![255; 8] });
        let view =
            |held_out, has_photo: bool| View { name: String::new(), camera, held_out, photo: has_photo.then(photo) };
        let first = |views| Scene { views, ..Scene::default() }.first_view();
        assert_eq!(first(vec![view(true, false), view(false, false), view(false, true)]), Some(2));
        assert_eq!(first(vec![view(true, false), view(false, false)]), Some(1));
        assert_eq!(first(vec![view(true, false)]), Some(0));
        assert_eq!(first(vec![]), None);
    }
}
