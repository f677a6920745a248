//! A trained model on disk: a model folder of ours or of the published code, or a one-file bundle.

mod error;
mod open;
mod save;
mod scene;
mod scene_check;

pub use crate::output::cameras::space;
pub use error::ModelError;
pub use open::is_bundle;
pub use scene::{MakeScene, load_scene};

use crate::camera::Camera;
use crate::config::{Background, TrainConfig, TransientSwitch};
use crate::dataset::{CellMask, Dataset, HostPhoto, Resolution};
use crate::ensemble::Member;
use crate::exposure::{Exposure, ExposureField};
use crate::gpu::Gpu;
use crate::levels::{self, Levels, Loading, Stream};
use crate::local_space::LocalSpace;
use crate::output::OutputFolder;
use crate::output::cameras::{CameraRecord, Split};
use crate::raster::Rasterizer;
use crate::render::{ImagePart, Renderer};
use crate::residual::{Precision, ResidualNetwork};
use crate::scene::{Gaussians, Harmonics, Splats};
use crate::sources::memory::MemoryBudget;
use crate::sources::source_store::SourceStore;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

/// How a model is opened.
#[derive(Clone, Debug, Default)]
pub struct ModelOptions {
    /// Scene folder, when it has moved since the training.
    pub source: Option<PathBuf>,
    /// Makes the scene of a model that was trained on none from disk.
    pub make_scene: Option<MakeScene>,
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
    /// Bytes of the files of residual networks.
    pub network_bytes: u64,
    /// Bytes of the bundle, where the model is one.
    pub bundle_bytes: Option<u64>,
    /// Exposures of the training photos by name, where they were corrected.
    exposure: Option<HashMap<String, Exposure>>,
    /// The further members of an ensemble.
    pub members: Vec<Member>,
    /// Training photos by name, where the model brings them.
    photos: Option<HashMap<String, HostPhoto>>,
    /// Another program wrote it: the scene has its cameras.
    foreign: bool,
    source: Option<PathBuf>,
    make_scene: Option<MakeScene>,
    gpu_memory: MemoryBudget,
    loading: Loading,
    harmonics: Harmonics,
    /// The scene, where it was needed.
    dataset: Option<Dataset>,
}

impl Model {
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
        let member = |member| self.member(&raster, part.as_ref(), member);
        let members = self.members.iter().map(member).collect::<Result<_, _>>()?;
        let (background, alike) = (self.config.background(), self.config.weighted_as_the_first());
        let renderer =
            |splats| Renderer::new(raster, splats, background, part).with_exposure(field).with_members(members, alike);
        let Some(levels) = &self.levels else {
            return Ok(renderer(Splats::upload_in(&self.gaussians.in_space(self.space()), gpu, self.harmonics)?));
        };
        let slots = |harmonics| levels::slots(levels, gpu.bytes_of(self.gpu_memory), gpu, harmonics);
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

    /// The renderer of a further member of an ensemble, whose photos are those of the first.
    fn member(
        &self,
        raster: &Arc<Rasterizer>,
        first: Option<&ImagePart>,
        member: &Member,
    ) -> Result<Renderer, ModelError> {
        let splats = Splats::upload_in(&member.gaussians.in_space(self.space()), raster.gpu(), self.harmonics)?;
        let own = |(weights, part): (&Vec<f32>, &ImagePart)| -> Result<_, ModelError> {
            Ok(ImagePart { network: ResidualNetwork::from_values(raster.gpu(), weights)?, ..part.clone() })
        };
        let part = member.network.as_ref().zip(first).map(own).transpose()?;
        let renderer = Renderer::new(raster.clone(), splats, self.config.background(), part);
        Ok(renderer.with_exposure(self.field(member.exposure.as_ref())?))
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

    /// Whether it was trained on a scene that the program made, not on one from disk.
    pub fn has_made_scene(&self) -> bool {
        self.config.source.is_none() && !self.foreign
    }

    /// Whether another program wrote it, which does not say the size of its photos.
    pub fn is_foreign(&self) -> bool {
        self.foreign
    }

    /// The exposures of its photos, where they were corrected.
    ///
    /// # Errors
    /// A training view has none.
    pub fn exposure_field(&self) -> Result<Option<ExposureField>, ModelError> {
        self.field(self.exposure.as_ref())
    }

    /// Bytes of the files of all bases; none where one is not there, or the model is a bundle.
    pub fn cloud_bytes(&self) -> Option<u64> {
        if self.bundle_bytes.is_some() {
            return None;
        }
        let size = |base| Some(self.folder.member_path(self.iteration, base).metadata().ok()?.len());
        (1..=self.config.ensemble() as usize).map(size).sum()
    }

    /// The exposures of its photos by name, where they were corrected.
    pub fn exposures(&self) -> Option<&HashMap<String, Exposure>> {
        self.exposure.as_ref()
    }

    /// Exposures of the training photos by name, in the order of the views.
    fn field(&self, photos: Option<&HashMap<String, Exposure>>) -> Result<Option<ExposureField>, ModelError> {
        let Some(photos) = photos else { return Ok(None) };
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
            if [record.camera.width, record.camera.height] != photo.size() {
                return Err(ModelError::PhotoSize { name: record.name.clone() });
            }
            let mask = if own.is_some() { None } else { self.learned_mask(record)? };
            Ok(match mask {
                Some(mask) => photo.clone().masked(Arc::new(mask)),
                None => photo.clone(),
            })
        };
        training.into_iter().map(photo).collect()
    }

    /// The photos of the training views by name, where the model brings them, as a bundle does.
    pub fn own_photos(&self) -> Option<&HashMap<String, HostPhoto>> {
        self.photos.as_ref()
    }

    /// Whether it is the folder of a training that learned masks.
    pub fn has_learned_masks(&self) -> bool {
        self.config.transients.mask != TransientSwitch::Off && self.bundle_bytes.is_none()
    }

    /// The learned mask of a training photo, where it has one. The photos of a bundle have it in their alpha.
    ///
    /// # Errors
    /// Its file is damaged or cannot be read.
    pub fn learned_mask(&self, record: &CameraRecord) -> Result<Option<CellMask>, ModelError> {
        if self.config.transients.mask == TransientSwitch::Off {
            return Ok(None);
        }
        let size = [record.camera.width, record.camera.height];
        Ok(self.folder.read_transients(self.iteration, &record.name, size)?)
    }

    fn image_part(&self, gpu: &Arc<Gpu>, network: &[f32]) -> Result<ImagePart, ModelError> {
        let photos = self.training_photos()?;
        let cameras: Arc<[Camera]> = self.training_views().iter().map(|record| record.camera).collect();
        let mut options = self.config.image_options();
        if let (Some(_), MemoryBudget::Bytes(limit)) = (&self.levels, self.gpu_memory) {
            // Photos and depth maps, an eighth each: the Gaussians take half of it.
            let most = limit / 8;
            let own = gpu.bytes_of(options.sources.memory);
            options.sources.memory = MemoryBudget::Bytes(own.map_or(most, |own| own.min(most)));
        }
        let budget = gpu.bytes_of(options.sources.memory);
        let photos = Arc::new(SourceStore::new(gpu.clone(), photos, budget)?);
        Ok(ImagePart { cameras, photos, network: ResidualNetwork::from_values(gpu, network)?, options })
    }
}
