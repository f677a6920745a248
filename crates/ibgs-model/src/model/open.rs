//! Models are opened: a folder of ours or of the published code, or a bundle.

use super::{Model, ModelError, ModelOptions};
use crate::bundle::Bundle;
use crate::config::schedule::Schedule;
use crate::config::{Method, Preset, TrainConfig};
use crate::dataset::{PrincipalPoint, Resampler};
use crate::ensemble::Member;
use crate::levels::Loading;
use crate::output::OutputFolder;
use crate::residual::weights;
use crate::scene::{Harmonics, read_ply};
use crate::sources::memory::MemoryBudget;
use std::io::Cursor;
use std::path::Path;

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
            // Without a source it would count as trained on a scene that was made.
            model.config.source = Some(std::path::absolute(source).unwrap_or_else(|_| source.clone()));
        }
        model.source.clone_from(&options.source);
        model.make_scene = options.make_scene;
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
        members: bundle.members,
        bundle_bytes: bytes,
        photos: Some(bundle.photos.into_iter().collect()),
        foreign: false,
        source: None,
        make_scene: None,
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
        let missing = folder.network_save_path(iteration, 1);
        log::warn!("{} is missing; without its network the model gives the base image alone", missing.display());
    }
    let network = network_path.as_deref().map(weights::load).transpose()?;
    let bytes = |path: &Path| path.metadata().map_or(0, |file| file.len());
    let mut network_bytes = network_path.as_deref().map_or(0, bytes);
    let mut members = Vec::new();
    for number in 2..=config.ensemble() as usize {
        let gaussians = read_ply(&folder.member_path(iteration, number))?;
        // Without that of the first it would be of no use.
        let has_network = network.is_some() && number <= config.residual.networks as usize;
        let path = has_network.then(|| folder.network_save_path(iteration, number));
        network_bytes += path.as_deref().map_or(0, bytes);
        let network = path.as_deref().map(weights::load).transpose()?;
        members.push(Member { gaussians, network, exposure: folder.read_exposures(iteration, number)? });
    }
    // Those of the scene take the place of a foreign folder's.
    let cameras = if foreign && options.source.is_some() { Vec::new() } else { folder.read_cameras()? };
    Ok(Model {
        path: path.to_owned(),
        exposure: if foreign { None } else { folder.read_exposures(iteration, 1)? },
        members,
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
        make_scene: None,
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
