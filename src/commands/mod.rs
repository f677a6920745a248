//! One module a command: parse, call the core, print.

pub mod bench;
pub mod eval;
pub mod info;
pub mod render;
pub mod train;

use anyhow::{Context, Result};
use ibgs_core::dataset::{self, Dataset, LoadOptions, Photo};
use ibgs_core::eval::{Score, score_view};
use ibgs_core::gpu::{AdapterChoice, Gpu};
use ibgs_core::raster::Rasterizer;
use ibgs_core::render::Rendered;
use ibgs_core::scene::{Splats, read_ply};
use ibgs_core::train::config::{DataConfig, TrainConfig};
use ibgs_core::train::output::cameras::Split;
use ibgs_core::train::output::results::{Protocol, ViewScore};
use ibgs_core::train::output::{OutputFolder, PictureKind};
use std::path::Path;
use std::sync::Arc;

/// An error with those of its causes that its own text does not tell already.
pub fn sentence(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// Opens the adapter that `--adapter` names.
pub fn open_gpu(adapter: Option<&String>) -> Result<Arc<Gpu>> {
    let choice = adapter.map_or(AdapterChoice::Best, |name| AdapterChoice::Named(name.clone()));
    let gpu = Gpu::open(&choice)?;
    eprintln!("adapter: {}", gpu.describe());
    Ok(gpu)
}

/// Loads the scene that a run was configured with.
pub fn load_scene(data: &DataConfig, seed: u64, source: &Path) -> Result<Dataset> {
    let options = LoadOptions {
        resolution: data.resolution.parse()?,
        images: data.images.clone(),
        max_resolution: data.max_resolution,
        eval: data.eval,
        eval_split_every: data.eval_split_every as usize,
        principal_point: data.principal_point.parse()?,
        seed,
        random_points: data.random_points as usize,
        progress: true,
    };
    let dataset = dataset::load(source, &options)?;
    for note in &dataset.notes {
        eprintln!("note: {note}");
    }
    Ok(dataset)
}

/// A trained model folder, opened.
pub struct Model {
    /// The folder.
    pub folder: OutputFolder,
    /// How it was trained.
    pub config: TrainConfig,
    /// Iteration of the loaded point cloud.
    pub iteration: u32,
    /// The Gaussians on the device.
    pub splats: Splats,
    /// The rasterizer.
    pub raster: Rasterizer,
}

impl Model {
    /// Opens the given or the latest iteration of a model folder.
    pub fn open(path: &Path, iteration: Option<u32>, adapter: Option<&String>) -> Result<Self> {
        let folder = OutputFolder::open(path)?;
        // Other programs' model folders have no options file of ours.
        let config = if folder.config_path().exists() { folder.read_config()? } else { TrainConfig::default() };
        let latest = folder.latest_iteration()?.context("the folder holds no point cloud")?;
        let iteration = iteration.unwrap_or(latest);
        let gaussians = read_ply(&folder.point_cloud_path(iteration))?;
        let gpu = open_gpu(adapter)?;
        let splats = Splats::upload(&gaussians, &gpu)?;
        Ok(Self { folder, config, iteration, splats, raster: Rasterizer::new(gpu) })
    }

    /// Colour behind the Gaussians.
    pub fn background(&self) -> [f32; 3] {
        [if self.config.white_background { 1.0 } else { 0.0 }; 3]
    }
}

/// Renders every held-out view into the model folder, and scores it. `told` hears of each.
pub fn score_test_views(
    raster: &Rasterizer,
    splats: &Splats,
    dataset: &Dataset,
    background: [f32; 3],
    (folder, iteration): (&OutputFolder, u32),
    told: impl Fn(&ViewScore),
) -> Result<Vec<ViewScore>> {
    let score_one = |&index: &usize| -> Result<ViewScore> {
        let view = &dataset.views[index];
        let (image, Score { psnr, ssim }) = score_view(raster, splats, view, background)?;
        write_pictures(folder, Split::Test, iteration, &view.name, &image, Some(&view.photo))?;
        let score = ViewScore { name: view.name.clone(), psnr, ssim };
        told(&score);
        Ok(score)
    };
    dataset.test.iter().map(score_one).collect()
}

/// What the figures of a run depend on.
pub fn protocol(config: &TrainConfig, dataset: &Dataset, gpu: &Gpu) -> Protocol {
    let resized = config.data.resolution != "1" || config.data.max_resolution.is_some();
    Protocol {
        resampler: if resized { "Lanczos3, or the scene's own reduced photos" } else { "none" }.to_owned(),
        factor: config.data.resolution.clone(),
        split: format!("{} of {} views, listed in split.json", dataset.test.len(), dataset.views.len()),
        principal_point: config.data.principal_point.clone(),
        device: gpu.describe(),
    }
}

/// Writes a rendered view, and its photo beside it.
pub fn write_pictures(
    folder: &OutputFolder,
    split: Split,
    iteration: u32,
    name: &str,
    image: &Rendered,
    photo: Option<&Photo>,
) -> Result<()> {
    let path = folder.picture_path(split, iteration, PictureKind::Base.folder(), name);
    ibgs_core::image_io::write_png(&path, image.width, image.height, &image.to_rgb8())?;
    if let Some(photo) = photo {
        let path = folder.picture_path(split, iteration, PictureKind::Truth.folder(), name);
        let rgb: Vec<u8> = photo.rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        ibgs_core::image_io::write_png(&path, photo.width, photo.height, &rgb)?;
    }
    Ok(())
}
