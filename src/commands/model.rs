//! Opens a trained model as the command line describes it.

use super::train::demo::MAKE_DEMO;
use super::{open_gpu, word};
use crate::advice::resolution;
use crate::progress::Bars;
use crate::stderr;
use anyhow::Result;
use clap::Args as ClapArgs;
use ibgs_core::config::Background;
use ibgs_core::dataset::Resolution;
use ibgs_core::gpu::{Gpu, Use};
use ibgs_core::levels::Loading;
use ibgs_core::model::{Model, ModelError, ModelOptions};
use ibgs_core::render::Renderer;
use ibgs_core::residual::Precision;
use ibgs_core::scene::{Gaussians, Harmonics};
use ibgs_core::sources::memory::MemoryBudget;
use std::ops::{Deref, DerefMut};
use std::path::PathBuf;
use std::sync::Arc;

/// Options of every command that reads a model's files.
#[derive(ClapArgs, Clone, Default)]
pub struct FileArgs {
    /// Model folder (as `ibgs train` writes it) or `.ibgs` bundle.
    pub model: PathBuf,
    /// Scene folder, if it has moved since the training.
    #[arg(short, long)]
    pub source: Option<PathBuf>,
    /// Saved iteration to open [default: the latest].
    #[arg(long)]
    pub iteration: Option<u32>,
    /// For a model folder of the published code: factor or width of the photos it was trained on [default: 1].
    #[arg(short, long, value_parser = resolution, allow_negative_numbers = true)]
    pub resolution: Option<Resolution>,
}

/// What a command does about the photos that a final image needs.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub enum Photos {
    /// It fails without them.
    #[default]
    Needed,
    /// It renders the base image alone where the scene that the model names, or a photo of it, is not there any more.
    IfThere,
    /// It renders the base image alone.
    Unused,
}

/// Options of every command that opens a model on a GPU.
#[derive(ClapArgs, Clone)]
pub struct ModelArgs {
    /// Its files.
    #[command(flatten)]
    pub files: FileArgs,
    /// GPU memory for the source photos: `auto`, `none` (no limit), or a size such as `512MiB` [default: as in the
    /// training].
    #[arg(long)]
    pub source_memory: Option<MemoryBudget>,
    /// Memory for decoded photos: `auto` (half of what is free), `none` (no limit), or a size such as `8GiB`; beyond it photos
    /// are decoded again when they are needed [default: as in the training].
    #[arg(long)]
    pub host_memory: Option<MemoryBudget>,
    /// Precision of the residual network, and of the colours in the pictures of `render` and in levels of detail: `full`
    /// (float32) or `auto` (half precision; the network on matrix units that pass a test, else its activations alone).
    #[arg(long, default_value = "auto", value_parser = word::<Precision>())]
    pub precision: Precision,
    /// GPU memory for a bundle with levels of detail (`ibgs export --levels`): `auto`, `none` (all that the model needs), or a
    /// size such as `2GiB`; Gaussians take half of it, photos and depth maps an eighth each.
    #[arg(long, default_value = "auto")]
    pub gpu_memory: MemoryBudget,
    /// Adapter by number or part of its name; `ibgs info` lists them [default: the most capable].
    #[arg(long)]
    pub adapter: Option<String>,
    /// What is done about the photos.
    #[arg(skip)]
    pub photos: Photos,
    /// When frames of such a bundle are rendered.
    #[arg(skip)]
    pub loading: Loading,
    /// Colour behind the Gaussians: `white`, `black` or `R,G,B` [default: as in the training].
    #[arg(long, value_name = "COLOUR")]
    pub background: Option<Background>,
    /// How precisely the device keeps the colours.
    #[arg(skip)]
    pub harmonics: Harmonics,
}

impl FileArgs {
    /// Reads the model's files only, not the scene.
    pub fn read(&self) -> Result<Model> {
        self.read_with(&ModelOptions::default())
    }

    fn read_with(&self, others: &ModelOptions) -> Result<Model> {
        let options = ModelOptions {
            source: self.source.clone(),
            iteration: self.iteration,
            resolution: self.resolution,
            make_scene: Some(MAKE_DEMO),
            ..others.clone()
        };
        let model = Model::open(&self.model, &options)?;
        if model.is_foreign() && self.source.is_some() && self.resolution.is_none() {
            stderr!(
                "note: {} does not say at which size it saw its photos; they are taken as they are (`--resolution N` if it was \
                 trained on reduced ones)",
                self.model.display()
            );
        }
        Ok(model)
    }
}

impl ModelArgs {
    /// Files with the options that a command line has where it names none.
    pub fn of(files: FileArgs) -> Self {
        Self {
            files,
            source_memory: None,
            host_memory: None,
            precision: Precision::Auto,
            gpu_memory: MemoryBudget::Auto,
            adapter: None,
            background: None,
            photos: Photos::default(),
            loading: Loading::default(),
            harmonics: Harmonics::default(),
        }
    }

    /// Opens the model on the adapter that the command line names.
    pub fn open(&self) -> Result<OpenModel> {
        self.open_on(|| open_gpu(self.adapter.as_ref(), Use::Rendering), &Bars::default())
    }

    /// Opens the model on a GPU. `gpu` is called after the files have been read.
    pub fn open_on(&self, gpu: impl FnOnce() -> Result<Arc<Gpu>>, bars: &Bars) -> Result<OpenModel> {
        let mut model = self.files.read_with(&ModelOptions {
            source_memory: self.source_memory,
            host_memory: self.host_memory,
            precision: self.precision,
            gpu_memory: self.gpu_memory,
            background: self.background,
            loading: self.loading,
            harmonics: self.harmonics,
            ..ModelOptions::default()
        })?;
        if self.photos == Photos::Unused {
            model.without_residual();
        }
        match model.load_photos(bars) {
            Err(ModelError::SceneGone { .. } | ModelError::PhotosGone { .. } | ModelError::Scene(_))
                if self.photos == Photos::IfThere && self.files.source.is_none() =>
            {
                model.without_residual();
            }
            loaded => loaded?,
        }
        let renderer = model.renderer(&gpu()?)?;
        // The renderer has them on the device.
        model.gaussians = Gaussians::default();
        model.members.iter_mut().for_each(|member| member.gaussians = Gaussians::default());
        Ok(OpenModel { model, renderer })
    }
}

/// A model and its renderer.
pub struct OpenModel {
    /// The model, without its Gaussians.
    model: Model,
    /// The renderer.
    pub renderer: Renderer,
}

impl Deref for OpenModel {
    type Target = Model;
    fn deref(&self) -> &Model {
        &self.model
    }
}

impl DerefMut for OpenModel {
    fn deref_mut(&mut self) -> &mut Model {
        &mut self.model
    }
}

impl OpenModel {
    /// Both on their own.
    pub fn into_parts(self) -> (Model, Renderer) {
        (self.model, self.renderer)
    }

    /// Renders every view in the mean exposure of the photos.
    pub fn levelled(self) -> Self {
        Self { renderer: self.renderer.levelled(), ..self }
    }

    /// Renders depth and normals with every frame, even if the final image does not need them.
    pub fn showing_surface(self) -> Self {
        Self { renderer: self.renderer.showing_surface(), ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct CommandLine {
        #[command(flatten)]
        args: ModelArgs,
    }

    /// The viewer has no command line of these; it once rendered in float32 where `ibgs render` did not.
    #[test]
    fn the_viewer_opens_models_as_the_command_line_does() {
        let parsed = CommandLine::parse_from(["ibgs", "model"]).args;
        let made = ModelArgs::of(FileArgs { model: "model".into(), ..FileArgs::default() });
        assert_eq!((parsed.files.model, parsed.precision), (made.files.model, made.precision));
        assert_eq!((parsed.source_memory, parsed.adapter), (made.source_memory, made.adapter));
    }
}
