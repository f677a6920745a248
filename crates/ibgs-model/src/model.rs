//! A trained model on disk: a model folder of ours or of the published code, or a one-file bundle.

mod error;
mod save;
mod scene_check;

pub use error::ModelError;

use crate::bundle::Bundle;
use crate::camera::Camera;
use crate::config::schedule::Schedule;
use crate::config::{Background, Method, Preset, TrainConfig};
use crate::dataset::demo::{self, DemoOptions};
use crate::dataset::{self, Dataset, HostPhoto, PrincipalPoint, Resampler, Resolution};
use crate::exposure::{Exposure, ExposureField};
use crate::gpu::Gpu;
use crate::levels::{self, Levels, Loading, Stream};
use crate::local_space::LocalSpace;
use crate::output::OutputFolder;
use crate::output::cameras::{self, CameraRecord, Split};
use crate::progress::Progress;
use crate::raster::Rasterizer;
use crate::render::{ImagePart, Renderer};
use crate::residual::{Precision, ResidualNetwork, weights};
use crate::scene::{Gaussians, Harmonics, Splats, read_ply};
use crate::sources::memory::MemoryBudget;
use crate::sources::source_store::SourceStore;
use std::collections::HashMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How a model is opened.
#[derive(Clone, Debug, Default)]
pub struct ModelOptions {
    /// Scene folder, when it has moved since the training.
    pub source: Option<PathBuf>,
    /// Iteration; none: the latest.
    pub iteration: Option<u32>,
    /// For a model folder of the published code: factor or width of the photos that it was trained on.
    pub resolution: Option<Resolution>,
    /// Device memory for the source photos; none: as in the training.
    pub source_memory: Option<MemoryBudget>,
    /// Memory of the host for decoded photos, in place of the run's.
    pub host_memory: Option<MemoryBudget>,
    /// How precisely the residual network computes.
    pub precision: Precision,
    /// Device memory for a model with levels of detail; other models are on the device as a whole.
    pub gpu_memory: MemoryBudget,
    /// Colour behind the Gaussians, in place of the run's.
    pub background: Option<Background>,
    /// When its frames are rendered.
    pub loading: Loading,
    /// How precisely the device keeps the colours; those that come while frames are rendered as `precision` says.
    pub harmonics: Harmonics,
}

/// A model, read from its files.
#[derive(Clone, Debug)]
pub struct Model {
    /// What was opened.
    pub path: PathBuf,
    /// Where results go: the model folder, or a folder beside the bundle.
    pub folder: OutputFolder,
    /// How it was trained.
    pub config: TrainConfig,
    /// Iteration of the loaded model.
    pub iteration: u32,
    /// The views that it was trained and measured on.
    pub cameras: Vec<CameraRecord>,
    /// The Gaussians, as the file has them.
    pub gaussians: Gaussians,
    /// The levels of detail of a bundle with them, of which `gaussians` are then the coarsest.
    pub levels: Option<Arc<Levels>>,
    /// Flat weights of the residual network.
    pub network: Option<Vec<f32>>,
    /// Bytes of the residual network's file.
    pub network_bytes: u64,
    /// Bytes of the bundle, where the model is one.
    pub bundle_bytes: Option<u64>,
    /// Exposures of the training photos by name, where they were corrected.
    exposure: Option<HashMap<String, Exposure>>,
    /// Training photos by name, where the model brings them.
    photos: Option<HashMap<String, HostPhoto>>,
    /// Another program wrote it: the scene has its cameras.
    foreign: bool,
    source: Option<PathBuf>,
    gpu_memory: MemoryBudget,
    loading: Loading,
    harmonics: Harmonics,
    /// The scene, where it was needed.
    dataset: Option<Dataset>,
}

impl Model {
    /// Reads a model's files; neither a GPU nor the scene are needed.
    ///
    /// # Errors
    /// A file that is missing or damaged, or an option that does not fit the model.
    pub fn open(path: &Path, options: &ModelOptions) -> Result<Self, ModelError> {
        let model = match is_bundle(path) {
            true => from_bundle(Bundle::read(path)?, path.metadata().ok().map(|file| file.len()), path)?,
            false if path.is_file() => return Err(ModelError::OtherFile { path: path.to_owned() }),
            false => from_folder(path, options)?,
        };
        model.with_options(options)
    }

    /// As [`Model::open`], for the bytes of a bundle; `path` is for messages.
    ///
    /// # Errors
    /// As [`Model::open`].
    pub fn from_bundle(bytes: &[u8], path: &Path, options: &ModelOptions) -> Result<Self, ModelError> {
        let bundle = Bundle::read_from(Cursor::new(bytes), path)?;
        from_bundle(bundle, Some(bytes.len() as u64), path)?.with_options(options)
    }

    /// The base image's part of a bundle, from the beginning of its bytes: all but network and photos. None where the
    /// beginning is too short for that.
    ///
    /// # Errors
    /// As [`Model::open`].
    pub fn from_bundle_start(start: &[u8], path: &Path, options: &ModelOptions) -> Result<Option<Self>, ModelError> {
        let Some(bundle) = Bundle::read_start(start, path)? else { return Ok(None) };
        Ok(Some(from_bundle(bundle, None, path)?.with_options(options)?))
    }

    fn with_options(self, options: &ModelOptions) -> Result<Self, ModelError> {
        let mut model = self;
        if let Some(wanted) = options.iteration.filter(|&n| n != model.iteration) {
            return Err(ModelError::OtherIteration { path: model.path, found: model.iteration, wanted });
        }
        if options.resolution.is_some() && !model.foreign {
            return Err(ModelError::KnowsItsPhotos { path: model.path });
        }
        if let Some(source) = &options.source {
            // Without a source it would count as trained on the built-in scene.
            model.config.data.source = Some(std::path::absolute(source).unwrap_or_else(|_| source.clone()));
        }
        model.source.clone_from(&options.source);
        if let Some(memory) = options.host_memory {
            model.config.data.host_memory = memory;
        }
        if let Some(memory) = options.source_memory {
            model.config.sources.memory = memory;
        }
        model.config.background = options.background.or(model.config.background);
        model.config.residual.precision = options.precision;
        (model.gpu_memory, model.loading, model.harmonics) = (options.gpu_memory, options.loading, options.harmonics);
        Ok(model)
    }

    /// Loads the scene where a renderer needs its photos or cameras: once, and not for a model that brings them.
    ///
    /// # Errors
    /// The scene is missing, damaged, or not the one that the model was trained on.
    pub fn load_photos(&mut self, progress: &dyn Progress) -> Result<(), ModelError> {
        if self.dataset.is_some() {
            return Ok(());
        }
        if let Some(source) = self.source.as_ref().filter(|_| self.foreign) {
            let found = load_scene(&self.config, source, progress)?;
            self.check_foreign(&found, source)?;
            self.cameras = cameras::records(&found);
            self.dataset = Some(found);
        } else if self.network.is_some() && self.photos.is_none() {
            self.dataset = Some(self.scene(progress)?);
        }
        Ok(())
    }

    /// The scene that the model was trained on, with the model's own split.
    ///
    /// # Errors
    /// As [`Model::load_photos`].
    pub fn dataset(&mut self, progress: &dyn Progress) -> Result<&Dataset, ModelError> {
        if self.dataset.is_none() {
            self.dataset = Some(self.scene(progress)?);
        }
        Ok(self.dataset.as_ref().expect("just loaded"))
    }

    /// Puts the model on a device; loads the scene where its photos are needed.
    ///
    /// # Errors
    /// Not enough memory, or as [`Model::load_photos`].
    pub fn renderer(&mut self, gpu: &Arc<Gpu>) -> Result<Renderer, ModelError> {
        self.load_photos(&())?;
        gpu.warm_up_rendering(self.network.is_some());
        let part = self.network.as_ref().map(|network| self.image_part(gpu, network)).transpose()?;
        let field = self.exposure_field()?;
        let raster = Arc::new(Rasterizer::new(gpu.clone()));
        let renderer = |splats| Renderer::new(raster, splats, self.config.background(), part).with_exposure(field);
        let Some(levels) = &self.levels else {
            return Ok(renderer(Splats::upload_in(&self.gaussians.in_space(self.space()), gpu, self.harmonics)?));
        };
        let slots = |harmonics| levels::slots(levels, self.gpu_memory.bytes(gpu), gpu, harmonics);
        if slots(self.harmonics).is_ok_and(|slots| slots == levels.leaves().count()) {
            // All of it fits.
            return Ok(renderer(Splats::upload_in(&levels.whole()?, gpu, self.harmonics)?));
        }
        // Nothing reads back what a window shows while it flies.
        let harmonics = match self.loading {
            Loading::Complete => self.harmonics,
            Loading::AsItComes(_) => self.config.residual.precision.of_colors(),
        };
        let (stream, splats) = Stream::new(levels.clone(), gpu, slots(harmonics)?, self.loading, harmonics)?;
        Ok(renderer(splats).with_stream(stream))
    }

    /// The local coordinates in which it is rendered: those of its training, from its cameras; without cameras, those
    /// of the Gaussians.
    pub fn space(&self) -> LocalSpace {
        space(&self.cameras, &self.gaussians, self.config.data.extent)
    }

    /// The views that it was trained on, in their order.
    pub fn training_views(&self) -> Vec<&CameraRecord> {
        self.cameras.iter().filter(|record| record.split != Some(Split::Test)).collect()
    }

    /// Whether it was trained on the built-in scene.
    pub fn is_demo(&self) -> bool {
        self.config.data.source.is_none() && !self.foreign
    }

    /// The exposures of its photos, where they were corrected.
    ///
    /// # Errors
    /// A training view has none.
    pub fn exposure_field(&self) -> Result<Option<ExposureField>, ModelError> {
        let Some(photos) = &self.exposure else { return Ok(None) };
        let training = self.training_views();
        let own = |record: &&CameraRecord| {
            photos.get(&record.name).copied().ok_or_else(|| ModelError::NoExposure { name: record.name.clone() })
        };
        let photos = training.iter().map(own).collect::<Result<Vec<_>, _>>()?;
        let cameras: Arc<[Camera]> = training.iter().map(|record| record.camera).collect();
        Ok(Some(ExposureField::new(cameras, photos)))
    }

    /// The photos of the training views, in their order, of the model itself or of the scene that is loaded
    /// ([`Model::load_photos`]).
    ///
    /// # Errors
    /// A photo is missing or has another size than its camera.
    pub fn training_photos(&self) -> Result<Vec<HostPhoto>, ModelError> {
        let training = self.training_views();
        let by_name: HashMap<&str, &HostPhoto> =
            self.dataset.iter().flat_map(|d| &d.views).map(|v| (v.name.as_str(), &v.photo)).collect();
        let photo = |record: &CameraRecord| {
            let own = self.photos.as_ref().and_then(|photos| photos.get(&record.name));
            let found = own.or_else(|| by_name.get(record.name.as_str()).copied());
            let photo = found.ok_or_else(|| ModelError::NoPhoto { name: record.name.clone() })?;
            match [record.camera.width, record.camera.height] == photo.size() {
                true => Ok(photo.clone()),
                false => Err(ModelError::PhotoSize { name: record.name.clone() }),
            }
        };
        training.into_iter().map(photo).collect()
    }

    fn image_part(&self, gpu: &Arc<Gpu>, network: &[f32]) -> Result<ImagePart, ModelError> {
        let photos = self.training_photos()?;
        let cameras: Arc<[Camera]> = self.training_views().iter().map(|record| record.camera).collect();
        let mut options = self.config.image_options();
        if let (Some(_), MemoryBudget::Bytes(limit)) = (&self.levels, self.gpu_memory) {
            // Photos and depth maps, an eighth each: the Gaussians take half of it.
            let most = limit / 8;
            let own = options.sources.memory.bytes(gpu);
            options.sources.memory = MemoryBudget::Bytes(own.map_or(most, |own| own.min(most)));
        }
        let budget = options.sources.memory.bytes(gpu);
        let photos = Arc::new(SourceStore::new(gpu.clone(), photos, budget)?);
        Ok(ImagePart { cameras, photos, network: ResidualNetwork::from_values(gpu, network)?, options })
    }

    /// Loads the scene that the model was trained on, with the model's own split.
    fn scene(&self, progress: &dyn Progress) -> Result<Dataset, ModelError> {
        let config = &self.config;
        let mut dataset = match self.source.as_ref().or(config.data.source.as_ref()) {
            Some(source) if self.source.is_none() && !source.exists() => {
                return Err(ModelError::SceneGone { path: source.clone() });
            }
            Some(source) => {
                let found = load_scene(config, source, progress)?;
                if self.source.is_some() {
                    scene_check::check(&self.cameras, &found, source)?;
                }
                found
            }
            None if self.foreign => return Err(ModelError::NoScene { path: self.path.clone() }),
            None => self.demo_scene(progress)?,
        };
        let split = |wanted: Split| {
            let named = self.cameras.iter().filter(|r| r.split == Some(wanted)).map(|r| &r.name);
            let found = named.map(|name| {
                let position = dataset.views.iter().position(|view| view.name == *name);
                position.ok_or_else(|| ModelError::NoPhoto { name: name.clone() })
            });
            found.collect::<Result<Vec<_>, _>>()
        };
        let (train, test) = (split(Split::Train)?, split(Split::Test)?);
        (dataset.train, dataset.test) = (train, test);
        Ok(dataset)
    }

    /// Compares a scene with the cameras that another program's folder lists, where it does.
    fn check_foreign(&self, scene: &Dataset, source: &Path) -> Result<(), ModelError> {
        if !self.folder.cameras_path().is_file() {
            return Ok(());
        }
        match self.folder.read_cameras() {
            Ok(listed) => {
                scene_check::check(&listed, scene, source)?;
                scene_check::say_unlisted(&listed, scene, source);
            }
            Err(error) => log::warn!("{error}; the scene {} is taken as the model's own", source.display()),
        }
        Ok(())
    }

    /// The demo scene in the size that the model's cameras have.
    fn demo_scene(&self, progress: &dyn Progress) -> Result<Dataset, ModelError> {
        let width = self.cameras.first().ok_or(ModelError::NoCameras)?.camera.width;
        let presets = [DemoOptions::small(), DemoOptions::large()];
        let preset = presets.into_iter().find(|p| p.width == width).ok_or(ModelError::DemoSize { width })?;
        Ok(load_demo(&preset, self.config.data.demo_exposure_seed, progress)?)
    }
}

/// Loads a scene as a run was configured with it; notes go to the log.
///
/// # Errors
/// The scene is missing or damaged, or an option makes no sense.
pub fn load_scene(
    config: &TrainConfig,
    source: &Path,
    progress: &dyn Progress,
) -> Result<Dataset, dataset::DatasetError> {
    let dataset = dataset::load_with(source, &config.load_options(), progress)?;
    for note in &dataset.notes {
        log::info!("{note}");
    }
    Ok(dataset)
}

/// Loads the demo scene; with a seed every photo has another exposure.
///
/// # Errors
/// Options outside of their range.
pub fn load_demo(
    options: &DemoOptions,
    exposure_seed: Option<u64>,
    progress: &dyn Progress,
) -> Result<Dataset, demo::DemoError> {
    let mut dataset = demo::load(options, None, progress)?;
    if let Some(seed) = exposure_seed {
        demo::change_exposure(&mut dataset, seed)?;
    }
    Ok(dataset)
}

/// The local coordinates in which a model is rendered: those of its training, from its cameras and the extent that they were
/// given; without cameras, those of the Gaussians.
pub fn space(cameras: &[CameraRecord], gaussians: &Gaussians, extent: Option<f64>) -> LocalSpace {
    let space = LocalSpace::of_scene(cameras.iter().map(|record| &record.camera), gaussians.positions());
    space.with_extent(extent)
}

/// Whether a path names a one-file bundle, there or not.
pub fn is_bundle(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "ibgs") && !path.is_dir()
}

fn from_bundle(bundle: Bundle, bytes: Option<u64>, path: &Path) -> Result<Model, ModelError> {
    let network_bytes = bundle.network.as_ref().map_or(0, |bytes| bytes.len() as u64);
    let network = bundle.network.map(|bytes| weights::from_bytes(&bytes, path)).transpose()?;
    Ok(Model {
        path: path.to_owned(),
        folder: OutputFolder::at(&path.with_extension("")),
        config: bundle.config,
        iteration: bundle.iteration,
        cameras: bundle.cameras,
        gaussians: bundle.gaussians,
        levels: bundle.levels,
        network,
        network_bytes,
        exposure: bundle.exposure,
        bundle_bytes: bytes,
        photos: Some(bundle.photos.into_iter().collect()),
        foreign: false,
        source: None,
        gpu_memory: MemoryBudget::Auto,
        loading: Loading::default(),
        harmonics: Harmonics::default(),
        dataset: None,
    })
}

fn from_folder(path: &Path, options: &ModelOptions) -> Result<Model, ModelError> {
    let folder = OutputFolder::open(path)?;
    let foreign = !folder.config_path().exists();
    let mut config = if foreign { published_options(options) } else { folder.read_config()? };
    // The plan of a block may have moved; its photos' names are here too.
    let own_split = folder.split_path();
    if config.data.split.is_some() && own_split.is_file() {
        config.data.split = Some(own_split);
    }
    let latest = folder.latest_iteration()?.ok_or_else(|| ModelError::NoPointCloud { path: path.to_owned() })?;
    let iteration = options.iteration.unwrap_or(latest);
    let gaussians = read_ply(&folder.point_cloud_path(iteration))?;
    let network_path = folder.network_path(iteration).filter(|_| config.method == Method::Ibgs);
    let residual = config.method == Method::Ibgs && Schedule::new(&config, config.iterations()).residual_at(iteration);
    if network_path.is_none() && residual && !foreign {
        let missing = folder.network_save_path(iteration);
        log::warn!("{} is missing; without its network the model gives the base image alone", missing.display());
    }
    let network = network_path.as_deref().map(weights::load).transpose()?;
    let network_bytes = network_path.and_then(|path| path.metadata().ok()).map_or(0, |file| file.len());
    // Those of the scene take the place of a foreign folder's.
    let cameras = if foreign && options.source.is_some() { Vec::new() } else { folder.read_cameras()? };
    Ok(Model {
        path: path.to_owned(),
        exposure: if foreign { None } else { folder.read_exposures(iteration)? },
        bundle_bytes: None,
        photos: None,
        folder,
        config,
        iteration,
        cameras,
        gaussians,
        levels: None,
        network,
        network_bytes,
        foreign,
        source: None,
        gpu_memory: MemoryBudget::Auto,
        loading: Loading::default(),
        harmonics: Harmonics::default(),
        dataset: None,
    })
}

/// How the published code trains and measures: its model folders have no options file of ours.
fn published_options(options: &ModelOptions) -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Published);
    config.data.eval = true;
    config.data.principal_point = PrincipalPoint::Centred;
    config.data.resampler = Resampler::Bicubic;
    config.data.resolution = options.resolution.unwrap_or_default();
    config
}
