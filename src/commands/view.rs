//! `ibgs view`

use super::export::shared;
use super::model::{FileArgs, ModelArgs, Photos};
use super::open_gpu;
use super::prepare::{Programs, scene_in_window};
use super::train::{DemoDefaults, Failure, Watched, prepare, requested};
use crate::advice::{self, resolution};
use crate::prepare::{inputs_in, is_video};
use crate::progress::Bars;
use crate::signals::{self, on_stop};
use crate::stderr;
use crate::stdout;
use anyhow::{Context, Error, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::camera::Camera;
use ibgs_core::config::Method;
use ibgs_core::dataset::{self, DatasetError, Point, Resolution};
use ibgs_core::gpu::{Gpu, Use};
use ibgs_core::levels::Loading;
use ibgs_core::local_space::LocalSpace;
use ibgs_core::model::is_bundle;
use ibgs_core::output::OutputFolder;
use ibgs_core::raster::Rasterizer;
use ibgs_core::render::Renderer;
use ibgs_core::scene::{Gaussians, Splats, read_gaussians};
use ibgs_core::sources::memory::MemoryBudget;
use ibgs_train::session::SessionBuilder;
use ibgs_viewer::{
    Content, NEXT_OF_PHOTOS, Open, OpenRequest, Opened, Outcome, PhotosRequest, Scene, ShareRequest, Status, Training,
    TrainingRequest, View, Watch,
};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Largest number of points that show the Gaussians of a file without a scene.
const MOST_POINTS: usize = 50_000;

/// Frames that `--measure` renders each way.
const MEASURED: usize = 300;

const EXAMPLES: &str = "\
Examples:
  ibgs view output/my-scene
  ibgs view photos                               # from photos to a model, step by step";

/// Limits of memory.
#[derive(ClapArgs, Clone, Copy, Default)]
struct Memory {
    /// GPU memory for a bundle with levels of detail: `auto`, `none` (all that the model needs), or a size such as `2GiB`.
    #[arg(long, default_value = "auto")]
    gpu_memory: MemoryBudget,
    /// Memory for decoded photos: `auto` (half of what is free), `none` (no limit), or a size such as `8GiB`; beyond it photos
    /// are decoded again when they are needed [default: as in the training].
    #[arg(long)]
    host_memory: Option<MemoryBudget>,
}

/// Options of `ibgs view`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Model folder, `.ibgs` bundle or file of Gaussians (`.ply` and others); a scene folder or a .zip of one opens the start
    /// page, which asks how to train on it, and so do photos without poses and a video, of which it makes a scene [default: the
    /// start page].
    model: Option<PathBuf>,
    /// Train in the window at once, on a scene folder or else on the built-in demo scene; `ibgs train --with-viewer` has
    /// all options of a training.
    #[arg(long, value_name = "SCENE", num_args = 0..=1, conflicts_with_all = ["model", "source", "iteration"])]
    train: Option<Option<PathBuf>>,
    /// Scene folder, if it has moved since the training.
    #[arg(short, long, requires = "model")]
    source: Option<PathBuf>,
    /// Saved iteration to open [default: the latest].
    #[arg(long, requires = "model")]
    iteration: Option<u32>,
    /// For a model folder of the published code: factor or width of the photos it was trained on [default: 1].
    #[arg(short, long, value_parser = resolution, allow_negative_numbers = true, requires = "model")]
    resolution: Option<Resolution>,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    programs: Programs,
    /// Open no window; print how much longer its frames take than the renderer alone.
    #[arg(long, requires = "model")]
    measure: bool,
    /// Adapter by number or part of its name; `ibgs info` lists them [default: the most capable].
    #[arg(long)]
    adapter: Option<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    if !args.measure {
        check_display(args.model.as_deref())?;
    }
    let open = |wanted| open_gpu(args.adapter.as_ref(), wanted);
    let opener = || Opener {
        memory: args.memory,
        programs: args.programs.clone(),
        files: args.model.as_ref().map(|path| args.files(path)).unwrap_or_default(),
        ..Opener::default()
    };
    if let Some(scene) = &args.train {
        let request = TrainingRequest { scene: scene.clone(), ..TrainingRequest::default() };
        let session = prepare(requested(&request)?, || open(Use::Training), &|_| {})?;
        return look(opener(), |failure| Watched::new(session, failure));
    }
    let gpu = || open(Use::Rendering);
    let (gpu, first) = match &args.model {
        None => (gpu()?, None),
        Some(path) => {
            if args.fits_a_scene()
                && let Some(Ok(outcome)) = beginning(path)
            {
                if let Outcome::Photos(_) = &outcome {
                    stderr!("next: {NEXT_OF_PHOTOS}");
                }
                return window(&gpu()?, opener(), Some(outcome));
            }
            let files = args.files(path);
            let wanted = ModelArgs { adapter: args.adapter.clone(), ..flying(ModelArgs::of(files), args.memory) };
            let (gpu, opened) = model(&wanted, gpu, &Bars::default())?;
            if args.measure {
                return measure(&gpu, opened);
            }
            (gpu, Some(Outcome::Opened(Box::new(opened))))
        }
    };
    window(&gpu, opener(), first)
}

impl Args {
    /// A model with the options that say which.
    fn files(&self, path: &Path) -> FileArgs {
        let (source, iteration, resolution) = (self.source.clone(), self.iteration, self.resolution);
        FileArgs { model: path.to_owned(), source, iteration, resolution }
    }

    /// No option asks for a model.
    fn fits_a_scene(&self) -> bool {
        !self.measure && self.source.is_none() && self.iteration.is_none() && self.resolution.is_none()
    }
}

/// Whether a path is no model, but may be a scene.
fn is_scene(path: &Path) -> bool {
    let is_model = || path.join("point_cloud").is_dir() || path.join("cameras.json").is_file();
    dataset::is_archive(path) || path.is_dir() && !is_model()
}

/// What a path leads to that is no model: a scene, or photos without poses.
///
/// # Errors
/// It is neither.
fn beginning(path: &Path) -> Option<Result<Outcome>> {
    if is_video(path) {
        return Some(Ok(Outcome::Photos(path.to_owned())));
    }
    if !is_scene(path) {
        return None;
    }
    Some(match dataset::inspect(path) {
        Ok(_) => Ok(Outcome::Scene(path.to_owned())),
        Err(error @ DatasetError::NotAScene { .. }) => inputs_in(path).map(Outcome::Photos).ok_or(error.into()),
        Err(error) => Err(error.into()),
    })
}

/// Times frames that move from view to view.
fn measure(gpu: &Gpu, opened: Opened) -> Result<()> {
    let Content::Model(renderer) = opened.content else { bail!("a training cannot be measured") };
    let views = &opened.scene.views;
    let size = if gpu.is_software() { [160, 100] } else { [1280, 800] };
    let camera = |i: usize| Some(views.get(i % views.len().max(1))?.camera.resized(size[0], size[1]));
    let cameras: Vec<Camera> = (0..MEASURED).filter_map(camera).collect();
    let times = ibgs_viewer::measure::measure(&renderer, &cameras)?;
    stdout!(
        "{} x {}: renderer alone {:.3} ms, to the window's texture {:.3} ms, {:.3} ms more (medians of {} frames on {})",
        size[0],
        size[1],
        times.alone,
        times.in_window,
        times.in_window - times.alone,
        cameras.len(),
        gpu.describe()
    );
    Ok(())
}

/// Opens a window on a training, which keeps its errors where `run` is told to, and trains until the window is closed.
///
/// # Errors
/// No window can be opened, or what a training in it failed with.
pub fn look(opener: Opener, run: impl FnOnce(&Failure) -> Watched) -> Result<()> {
    let run = run(&opener.failure);
    let gpu = run.session().gpu().clone();
    window(&gpu, opener, Some(Outcome::Opened(Box::new(trained(run)))))
}

/// Opens the window. A signal that stops the program closes it, so that a training in it is saved; where the user keeps
/// unsaved edits and the window, the signal is forgotten.
fn window(gpu: &Arc<Gpu>, opener: Opener, first: Option<Outcome>) -> Result<()> {
    let failure = opener.failure.clone();
    ibgs_viewer::run(gpu, opener, first, |closer| {
        on_stop(move || closer.close());
        Box::new(signals::forget)
    })?;
    failure.outcome()
}

/// Fails early if there is no display for a window, and says what does without one for what was to be shown.
pub fn check_display(shown: Option<&Path>) -> Result<()> {
    let set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let is_unix = cfg!(all(unix, not(target_os = "macos")));
    if is_unix && !set("DISPLAY") && !set("WAYLAND_DISPLAY") && !set("WAYLAND_SOCKET") {
        let without = match shown.map(|path| (path, beginning(path))) {
            Some((path, Some(Ok(Outcome::Photos(_))))) => {
                format!("`ibgs train {} --prepare` finds the poses and trains without one", advice::quoted(path))
            }
            _ => "use `ibgs train` and `ibgs render` without one".to_owned(),
        };
        bail!("there is no display for a window (neither DISPLAY nor WAYLAND_DISPLAY is set); {without}");
    }
    Ok(())
}

/// Opens what is dropped into the window or chosen on its start page.
#[derive(Default)]
pub struct Opener {
    /// What a training in the window failed with.
    failure: Failure,
    /// Of the command line.
    memory: Memory,
    programs: Programs,
    files: FileArgs,
}

/// The same with frames that do not wait for chunks, also of a model whose photos are gone.
fn flying(wanted: ModelArgs, Memory { gpu_memory, host_memory }: Memory) -> ModelArgs {
    ModelArgs { gpu_memory, host_memory, loading: Loading::FLYING, photos: Photos::IfThere, ..wanted }
}

impl Opener {
    /// The same with these programs for photos without poses.
    pub fn with_programs(self, programs: Programs) -> Self {
        Self { programs, ..self }
    }

    /// Begins a training.
    ///
    /// # Errors
    /// Those of [`prepare`].
    pub fn train(&self, training: SessionBuilder, gpu: &Arc<Gpu>, status: &Status<'_>) -> Result<Opened> {
        let session = prepare(training, || Ok(gpu.clone()), status)?;
        Ok(trained(Watched::new(session, &self.failure)))
    }
}

/// Fails if there is nothing at a path.
fn check_path(path: &Path) -> Result<()> {
    if !path.exists() {
        bail!("{} does not exist; check the path", path.display());
    }
    Ok(())
}

impl Open for Opener {
    fn sentence(&self, error: &Error) -> String {
        advice::sentence(error)
    }

    fn demo_iterations(&self, gpu: &Gpu) -> u32 {
        DemoDefaults::of(gpu).iterations
    }

    fn share(&self, wanted: &ShareRequest) -> Result<Vec<String>> {
        let opened = self.files.model == wanted.model;
        let files =
            if opened { self.files.clone() } else { FileArgs { model: wanted.model.clone(), ..FileArgs::default() } };
        shared(wanted, files)
    }

    fn prepare(&self, wanted: &PhotosRequest, watch: &Watch) -> Result<PathBuf> {
        scene_in_window(wanted, &self.programs, watch)
    }

    fn open(&self, wanted: &OpenRequest, gpu: &Arc<Gpu>, status: &Status<'_>) -> Result<Outcome> {
        let opened = match wanted {
            OpenRequest::Train(request) => {
                request.scene.as_deref().map_or(Ok(()), check_path)?;
                self.train(requested(request)?, gpu, status)?
            }
            OpenRequest::Path(path) => {
                check_path(path)?;
                if let Some(outcome) = beginning(path) {
                    return outcome;
                }
                let files = FileArgs { model: path.clone(), ..FileArgs::default() };
                let wanted = flying(ModelArgs::of(files), self.memory);
                model(&wanted, || Ok(gpu.clone()), &Bars::telling(status, "opening the model"))?.1
            }
        };
        Ok(Outcome::Opened(Box::new(opened)))
    }
}

fn trained(run: Watched) -> Opened {
    let session = run.session();
    let (dataset, folder) = (session.dataset(), session.folder().map(OutputFolder::root));
    let scene = Scene {
        title: folder.map_or_else(String::new, |folder| folder.display().to_string()),
        path: folder.map(Path::to_owned),
        views: View::all(dataset),
        points: dataset.points.clone(),
        pictures: folder.map(Path::to_owned).unwrap_or_default(),
        model: None,
        note: None,
    };
    Opened { scene, content: Content::Training(Box::new(run) as Box<dyn Training>) }
}

/// Opens a model folder, a bundle or a file of Gaussians.
fn model(args: &ModelArgs, gpu: impl FnOnce() -> Result<Arc<Gpu>>, bars: &Bars) -> Result<(Arc<Gpu>, Opened)> {
    let path = &args.files.model;
    let title = path.display().to_string();
    if !path.is_dir() && !is_bundle(path) {
        return plain(path, title, gpu);
    }
    let mut model = args.open_on(gpu, bars)?.showing_surface();
    let pictures = model.folder.root().to_owned();
    // A model can be viewed without the photos of its scene.
    let mut note = None;
    let own = model.own_photos().cloned();
    let (mut photos, points) = match model.dataset(bars) {
        Ok(dataset) => {
            let photo = |view: &ibgs_core::dataset::View| (view.name.clone(), view.photo.clone());
            (dataset.views.iter().map(photo).collect(), dataset.points.clone())
        }
        // A bundle lacks held-out photos alone.
        Err(_) if own.is_some() => (HashMap::new(), Vec::new()),
        Err(error) => {
            let lacks_final = model.config.method == Method::Ibgs && model.renderer.part().is_none();
            let shown = if lacks_final { "the base image is shown" } else { "it is shown" };
            let said = format!("{shown} without photos of the views: {}", advice::sentence(&error.into()));
            stderr!("note: {said}");
            note = Some(said);
            (HashMap::new(), Vec::new())
        }
    };
    // Those of a bundle may have masks that the scene does not have.
    photos.extend(own.unwrap_or_default());
    let view = |record| -> Result<View> {
        let view = View::of(record, &photos);
        Ok(match (model.learned_mask(record)?, &view.photo) {
            (Some(mask), Some(photo)) => View { photo: Some(photo.clone().masked(Arc::new(mask))), ..view },
            _ => view,
        })
    };
    let views = model.cameras.iter().map(view).collect::<Result<_>>()?;
    let (model, renderer) = model.into_parts();
    let gpu = renderer.gpu().clone();
    let content = Content::Model(Arc::new(renderer));
    let scene = Scene { title, path: Some(path.clone()), views, points, pictures, model: Some(Arc::new(model)), note };
    Ok((gpu, Opened { scene, content }))
}

/// Opens a file of Gaussians.
fn plain(path: &Path, title: String, gpu: impl FnOnce() -> Result<Arc<Gpu>>) -> Result<(Arc<Gpu>, Opened)> {
    let gaussians = read_gaussians(path)?;
    // Without cameras the Gaussians give the scale.
    let space = LocalSpace::of_points(gaussians.positions()).unwrap_or(gaussians.space);
    let gaussians = gaussians.into_space(space);
    let gpu = gpu()?;
    let splats = Splats::upload(&gaussians, &gpu)?;
    let renderer = Renderer::new(Arc::new(Rasterizer::new(gpu.clone())), splats, [0.0; 3], None).showing_surface();
    let pictures = path.parent().context("a file has a folder")?.join("pictures");
    let (views, points) = (Vec::new(), points(&gaussians));
    let scene = Scene { title, path: Some(path.to_owned()), views, points, pictures, model: None, note: None };
    Ok((gpu, Opened { scene, content: Content::Model(Arc::new(renderer)) }))
}

/// A subset of the Gaussians as points; they show where the scene is.
fn points(gaussians: &Gaussians) -> Vec<Point> {
    let step = gaussians.len().div_ceil(MOST_POINTS).max(1);
    gaussians.positions().step_by(step).map(|position| Point { position, color: [200; 3] }).collect()
}
