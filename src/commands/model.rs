//! A trained model, opened as the command line says.

use super::open_gpu;
use crate::progress::Bars;
use anyhow::{Error, Result, anyhow};
use clap::Args as ClapArgs;
use ibgs_core::gpu::Gpu;
use ibgs_core::model::{Model, ModelError, ModelOptions};
use ibgs_core::render::Renderer;
use ibgs_core::residual::Precision;
use ibgs_core::scene::Gaussians;
use ibgs_core::sources::memory::MemoryBudget;
use std::ops::{Deref, DerefMut};
use std::path::PathBuf;
use std::sync::Arc;

/// Options of every command that opens a model.
#[derive(ClapArgs, Clone, Default)]
pub struct ModelArgs {
    /// Model folder, as `ibgs train` writes it, or an `.ibgs` bundle.
    pub model: PathBuf,
    /// Scene folder, when it has moved since the training.
    #[arg(short, long)]
    pub source: Option<PathBuf>,
    /// Iteration; left out: the latest.
    #[arg(long)]
    pub iteration: Option<u32>,
    /// For a model folder of the published code: factor or width of the photos that it was trained on.
    #[arg(short, long)]
    pub resolution: Option<String>,
    /// GPU memory for the source photos: `auto`, `none` (no limit), or a size such as `512MiB`.
    #[arg(long)]
    pub source_memory: Option<MemoryBudget>,
    /// `auto`: the residual network in half precision on matrix units where they pass a test; `full`: float32.
    #[arg(long, default_value = "auto")]
    pub precision: Precision,
    /// Adapter by number or part of its name; `ibgs info` lists them.
    #[arg(long)]
    pub adapter: Option<String>,
}

impl ModelArgs {
    /// Reads the model's files alone.
    pub fn read(&self) -> Result<Model> {
        let options = ModelOptions {
            source: self.source.clone(),
            iteration: self.iteration,
            resolution: self.resolution.clone(),
            source_memory: self.source_memory,
            precision: self.precision,
        };
        Model::open(&self.model, &options).map_err(advised)
    }

    /// Opens the model on the adapter that the command line names.
    pub fn open(&self) -> Result<OpenModel> {
        self.open_on(|| open_gpu(self.adapter.as_ref()))
    }

    /// Opens the model on a GPU, which is asked for after the files have been read.
    pub fn open_on(&self, gpu: impl FnOnce() -> Result<Arc<Gpu>>) -> Result<OpenModel> {
        let mut model = self.read()?;
        model.load_photos(&Bars::default()).map_err(advised)?;
        let renderer = model.renderer(&gpu()?).map_err(advised)?;
        // They are on the device now.
        model.gaussians = Gaussians::default();
        Ok(OpenModel { model, renderer })
    }
}

/// What the command line can do about an error.
pub fn advised(error: ModelError) -> Error {
    let advice = match &error {
        ModelError::OtherIteration { .. } => "leave `--iteration` out",
        ModelError::KnowsItsPhotos { .. } => "leave `--resolution` out",
        ModelError::NoScene { .. } => "give the scene folder with `--source`",
        _ => return error.into(),
    };
    anyhow!("{error}; {advice}")
}

/// A model with what renders it.
pub struct OpenModel {
    /// The model, without its Gaussians.
    model: Model,
    /// Renders it.
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
    /// Every view in the photos' mean exposure.
    pub fn levelled(self) -> Self {
        Self { renderer: self.renderer.levelled(), ..self }
    }

    /// Depth and normals of every frame, also of a model that does not need them.
    pub fn showing_surface(self) -> Self {
        Self { renderer: self.renderer.showing_surface(), ..self }
    }
}
