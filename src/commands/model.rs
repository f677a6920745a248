//! A trained model, opened: a model folder or a one-file bundle.

use super::{load_demo, load_scene, open_gpu};
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::bundle::Bundle;
use ibgs_core::camera::Camera;
use ibgs_core::dataset::demo::DemoOptions;
use ibgs_core::dataset::{Dataset, Photo};
use ibgs_core::exposure::{self, Exposure, ExposureField};
use ibgs_core::fuse::source_store::SourceStore;
use ibgs_core::fuse::sources::Distances;
use ibgs_core::gpu::Gpu;
use ibgs_core::local_space::LocalSpace;
use ibgs_core::raster::Rasterizer;
use ibgs_core::render::{ImageOptions, ImagePart, Renderer};
use ibgs_core::residual::{ResidualNetwork, weights};
use ibgs_core::scene::{Gaussians, Splats, read_ply};
use ibgs_core::tell;
use ibgs_core::train::config::{Method, TrainConfig};
use ibgs_core::train::output::OutputFolder;
use ibgs_core::train::output::cameras::{self, CameraRecord, Split};
use ibgs_core::train::schedule::Schedule;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
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
    pub source_memory: Option<ibgs_core::fuse::memory::MemoryBudget>,
    /// `auto`: the residual network in half precision on matrix units where they pass a test; `full`: float32.
    #[arg(long, default_value = "auto")]
    pub precision: ibgs_core::residual::Precision,
    /// Adapter by number or part of its name; `ibgs info` lists them.
    #[arg(long)]
    pub adapter: Option<String>,
}

/// A model with what it needs to be rendered.
pub struct Model {
    /// Where results go: the model folder, or a folder beside the bundle.
    pub folder: OutputFolder,
    /// How it was trained.
    pub config: TrainConfig,
    /// Iteration of the loaded model.
    pub iteration: u32,
    /// The views that it was trained and measured on.
    pub cameras: Vec<CameraRecord>,
    /// Renders it.
    pub renderer: Renderer,
    /// The scene, where its photos were needed.
    dataset: Option<Dataset>,
    /// Bytes of the residual network's file.
    pub network_bytes: u64,
    /// Bytes of the bundle, where the model is one.
    pub bundle_bytes: Option<u64>,
    /// Another program wrote it.
    foreign: bool,
}

/// A model before it is on the device.
struct Loaded {
    folder: OutputFolder,
    config: TrainConfig,
    iteration: u32,
    cameras: Vec<CameraRecord>,
    gaussians: Gaussians,
    network: Option<Vec<f32>>,
    network_bytes: u64,
    exposure: Option<HashMap<String, Exposure>>,
    bundle_bytes: Option<u64>,
    /// Training photos by name, where the model brings them.
    photos: Option<HashMap<String, Arc<Photo>>>,
    /// Another program wrote it: the scene tells its cameras.
    foreign: bool,
}

impl Model {
    /// Opens a model on the adapter that the command line names.
    pub fn open(args: &ModelArgs) -> Result<Self> {
        Self::open_on(args, || open_gpu(args.adapter.as_ref()))
    }

    /// Opens a model on a GPU, which is asked for after the files have been read.
    pub fn open_on(args: &ModelArgs, gpu: impl FnOnce() -> Result<Arc<Gpu>>) -> Result<Self> {
        let mut loaded = load(args)?;
        if let Some(memory) = args.source_memory {
            loaded.config.sources.memory = memory;
        }
        loaded.config.residual.precision = args.precision;
        let mut dataset = None;
        if loaded.foreign && args.source.is_some() {
            let found = scene_as_split(&loaded.config, args)?;
            loaded.cameras = cameras::records(&found);
            dataset = Some(found);
        } else if loaded.network.is_some() && loaded.photos.is_none() {
            dataset = Some(scene(&loaded.config, &loaded.cameras, args)?);
        }
        let space = space(&loaded.cameras, &loaded.gaussians);
        let gpu = gpu()?;
        let part = loaded.network.as_ref().map(|n| image_part(&gpu, &loaded, n, dataset.as_ref())).transpose()?;
        let splats = Splats::upload(&loaded.gaussians.in_space(space), &gpu)?;
        let background = loaded.config.background();
        let field = exposure_field(&loaded)?;
        let renderer = Renderer::new(Arc::new(Rasterizer::new(gpu)), splats, background, part).with_exposure(field);
        let Loaded { folder, config, iteration, cameras, network_bytes, bundle_bytes, foreign, .. } = loaded;
        Ok(Self { folder, config, iteration, cameras, renderer, dataset, network_bytes, bundle_bytes, foreign })
    }

    /// Every view in the photos' mean exposure.
    pub fn levelled(self) -> Self {
        Self { renderer: self.renderer.levelled(), ..self }
    }

    /// Depth and normals of every frame, also of a model that does not need them.
    pub fn showing_surface(self) -> Self {
        Self { renderer: self.renderer.showing_surface(), ..self }
    }

    /// Whether it was trained on the built-in scene.
    pub fn is_demo(&self) -> bool {
        self.config.data.source.is_none() && !self.foreign
    }

    /// The scene that the model was trained on, with the model's own split.
    pub fn dataset(&mut self, args: &ModelArgs) -> Result<&Dataset> {
        if self.dataset.is_none() {
            self.dataset = Some(scene(&self.config, &self.cameras, args)?);
        }
        Ok(self.dataset.as_ref().expect("just loaded"))
    }
}

/// The Gaussians alone, as the file has them: neither scene nor adapter are needed.
pub fn gaussians(args: &ModelArgs) -> Result<Gaussians> {
    Ok(load(args)?.gaussians)
}

/// Where a model is rendered: where it was trained, as its cameras tell; by the Gaussians where they do not.
pub fn space(cameras: &[CameraRecord], gaussians: &Gaussians) -> LocalSpace {
    LocalSpace::of_scene(cameras.iter().map(|record| &record.camera), gaussians.positions())
}

/// Whether a path names a one-file bundle, there or not.
pub fn is_bundle(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "ibgs") && !path.is_dir()
}

fn load(args: &ModelArgs) -> Result<Loaded> {
    let loaded = if is_bundle(&args.model) { from_bundle(&args.model)? } else { from_folder(args)? };
    let name = args.model.display();
    if let Some(other) = args.iteration.filter(|&n| n != loaded.iteration) {
        bail!("{name} holds iteration {} alone, not {other}; leave `--iteration` out", loaded.iteration);
    }
    if args.resolution.is_some() && !loaded.foreign {
        bail!("{name} says itself which photos it was trained on; leave `--resolution` out");
    }
    Ok(loaded)
}

fn from_bundle(path: &Path) -> Result<Loaded> {
    let bundle = Bundle::read(path)?;
    let bundle_bytes = Some(path.metadata()?.len());
    let network_bytes = bundle.network.as_ref().map_or(0, |bytes| bytes.len() as u64);
    let network = bundle.network.map(|bytes| weights::from_bytes(&bytes, path)).transpose()?;
    Ok(Loaded {
        folder: OutputFolder::at(&path.with_extension("")),
        config: bundle.config,
        iteration: bundle.iteration,
        cameras: bundle.cameras,
        gaussians: bundle.gaussians,
        network,
        network_bytes,
        exposure: bundle.exposure,
        bundle_bytes,
        photos: Some(bundle.photos.into_iter().collect()),
        foreign: false,
    })
}

fn from_folder(args: &ModelArgs) -> Result<Loaded> {
    let folder = OutputFolder::open(&args.model)?;
    let foreign = !folder.config_path().exists();
    let config = if foreign { published_options(args) } else { folder.read_config()? };
    let latest = folder.latest_iteration()?.context("the folder holds no point cloud")?;
    let iteration = args.iteration.unwrap_or(latest);
    let path = folder.network_path(iteration).filter(|_| config.method == Method::Ibgs);
    let residual = config.method == Method::Ibgs && Schedule::new(&config, config.iterations).residual_at(iteration);
    if path.is_none() && residual && !foreign {
        let missing = folder.network_save_path(iteration);
        tell!("warning: {} is missing; without its network the model gives the base image alone", missing.display());
    }
    let network = path.as_deref().map(weights::load).transpose()?;
    let network_bytes = path.and_then(|path| path.metadata().ok()).map_or(0, |file| file.len());
    let gaussians = read_ply(&folder.point_cloud_path(iteration))?;
    // Those of the scene take the place of a foreign folder's.
    let cameras = if foreign && args.source.is_some() { Vec::new() } else { folder.read_cameras()? };
    Ok(Loaded {
        exposure: if foreign { None } else { folder.read_exposures(iteration)? },
        bundle_bytes: None,
        photos: None,
        folder,
        config,
        iteration,
        cameras,
        gaussians,
        network,
        network_bytes,
        foreign,
    })
}

/// How the published code trains and measures: its model folders have no options file of ours.
fn published_options(args: &ModelArgs) -> TrainConfig {
    let mut config = TrainConfig::default();
    config.data.eval = true;
    config.data.principal_point = "centred".to_owned();
    config.data.resampler = "bicubic".to_owned();
    config.data.resolution = args.resolution.clone().unwrap_or(config.data.resolution);
    config.sources.distances = Distances::Absolute;
    config
}

/// The views that the model was trained on, in their order.
pub fn training(cameras: &[CameraRecord]) -> Vec<&CameraRecord> {
    cameras.iter().filter(|record| record.split != Some(Split::Test)).collect()
}

fn exposure_field(loaded: &Loaded) -> Result<Option<ExposureField>> {
    let Some(photos) = &loaded.exposure else { return Ok(None) };
    let training = training(&loaded.cameras);
    let own = |record: &&CameraRecord| {
        let missing = || format!("the model's {} has no exposure of `{}`", exposure::FILE_NAME, record.name);
        photos.get(&record.name).copied().with_context(missing)
    };
    let photos = training.iter().map(own).collect::<Result<Vec<_>>>()?;
    let cameras: Arc<[Camera]> = training.iter().map(|record| record.camera).collect();
    Ok(Some(ExposureField::new(cameras, photos)))
}

fn image_part(gpu: &Arc<Gpu>, loaded: &Loaded, network: &[f32], dataset: Option<&Dataset>) -> Result<ImagePart> {
    let training = training(&loaded.cameras);
    let by_name: HashMap<&str, &Arc<Photo>> =
        dataset.iter().flat_map(|d| &d.views).map(|v| (v.name.as_str(), &v.photo)).collect();
    let photo = |record: &&CameraRecord| {
        let own = loaded.photos.as_ref().and_then(|photos| photos.get(&record.name));
        let photo = own.or_else(|| by_name.get(record.name.as_str()).copied());
        photo.cloned().with_context(|| format!("the scene has no photo `{}` any more", record.name))
    };
    let photos = training.iter().map(photo).collect::<Result<Vec<_>>>()?;
    let cameras: Arc<[Camera]> = training.iter().map(|record| record.camera).collect();
    if let Some((record, _)) =
        training.iter().zip(&photos).find(|(r, p)| [r.camera.width, r.camera.height] != [p.width, p.height])
    {
        bail!("the photo `{}` has another size than the model's camera; give the scene as it was trained", record.name);
    }
    let options = ImageOptions::new(&loaded.config);
    let budget = options.sources.memory.bytes(gpu);
    let photos = Arc::new(SourceStore::new(gpu.clone(), photos, budget)?);
    Ok(ImagePart { cameras, photos, network: ResidualNetwork::from_values(gpu, network)?, options })
}

/// Loads the scene of a model that does not say how it was split.
fn scene_as_split(config: &TrainConfig, args: &ModelArgs) -> Result<Dataset> {
    let source = args.source.as_ref().context("give the scene folder with `--source`")?;
    load_scene(config, source)
}

/// Loads the scene that a model was trained on, with the model's own split.
fn scene(config: &TrainConfig, records: &[CameraRecord], args: &ModelArgs) -> Result<Dataset> {
    let mut dataset = match args.source.as_ref().or(config.data.source.as_ref()) {
        Some(source) => load_scene(config, source)?,
        None if args.model.is_dir() && !args.model.join("config.toml").exists() => bail!(
            "{} has no config.toml that names its scene; give the scene folder with `--source`",
            args.model.display()
        ),
        None => demo_scene(records, config.data.demo_exposure_seed)?,
    };
    let split = |wanted: Split| {
        let named = records.iter().filter(|r| r.split == Some(wanted)).map(|r| &r.name);
        let found = named.map(|name| {
            let position = dataset.views.iter().position(|view| view.name == *name);
            position.with_context(|| format!("the scene has no photo `{name}` any more"))
        });
        found.collect::<Result<Vec<_>>>()
    };
    let (train, test) = (split(Split::Train)?, split(Split::Test)?);
    (dataset.train, dataset.test) = (train, test);
    Ok(dataset)
}

/// The demo scene in the size that the model's cameras have.
fn demo_scene(records: &[CameraRecord], exposure_seed: Option<u64>) -> Result<Dataset> {
    let width = records.first().context("the model has no cameras")?.camera.width;
    let presets = [DemoOptions::small(), DemoOptions::large()];
    let preset = presets.into_iter().find(|p| p.width == width).context("the model's demo scene has another size")?;
    load_demo(&preset, exposure_seed)
}
