//! The scene that a model was trained on, loaded where its photos or cameras are needed.

use super::{Model, ModelError, scene_check};
use crate::camera::Camera;
use crate::config::TrainConfig;
use crate::dataset::{self, Dataset, HostPhoto};
use crate::output::cameras::{self, CameraRecord, Split};
use crate::progress::Progress;
use crate::similarity::Similarity;
use std::collections::{HashMap, HashSet};
use std::error::Error;
use std::path::Path;

/// Makes a scene: with photos of this width, as the options of the training say.
pub type MakeScene = fn(u32, &TrainConfig, &dyn Progress) -> Result<Dataset, Box<dyn Error + Send + Sync>>;

impl Model {
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

    /// As [`Model::training_photos`]; loads the scene where the model does not bring its photos.
    ///
    /// # Errors
    /// As [`Model::load_photos`], or as [`Model::training_photos`].
    pub fn load_training_photos(&mut self, progress: &dyn Progress) -> Result<Vec<HostPhoto>, ModelError> {
        if self.photos.is_none() {
            self.dataset(progress)?;
        }
        self.training_photos()
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

    /// Loads the scene that the model was trained on, with the model's own split.
    fn scene(&self, progress: &dyn Progress) -> Result<Dataset, ModelError> {
        let config = &self.config;
        let mut dataset = match self.source.as_ref().or(config.source.as_ref()) {
            Some(source) if self.source.is_none() && !source.exists() => {
                return Err(ModelError::SceneGone { path: source.clone() });
            }
            Some(source) => load_scene(config, source, progress)?,
            None if self.foreign => return Err(ModelError::NoScene { path: self.path.clone() }),
            None => self.made_scene(progress)?,
        };
        // A bundle may have been moved.
        if self.photos.is_some() {
            self.move_scene(&mut dataset);
        }
        if let Some(source) = &self.source {
            scene_check::check(&self.cameras, &dataset, source)?;
        }
        let places: HashMap<&str, usize> = dataset.views.iter().enumerate().map(|(i, view)| (&*view.name, i)).collect();
        self.check_names(&dataset.path, |name| places.contains_key(name))?;
        let split = |wanted: Split| {
            let named = self.cameras.iter().filter(|record| record.split == Some(wanted));
            named.filter_map(|record| places.get(&*record.name).copied()).collect()
        };
        let (train, test) = (split(Split::Train), split(Split::Test));
        (dataset.train, dataset.test) = (train, test);
        if config.poses.change() || self.photos.is_some() {
            self.give_cameras(&mut dataset);
        }
        Ok(dataset)
    }

    /// Looks for the photos that the model was trained and measured on among those of a scene.
    fn check_names(&self, scene: &Path, is_there: impl Fn(&str) -> bool) -> Result<(), ModelError> {
        let used = || self.cameras.iter().filter(|record| record.split.is_some()).map(|record| &record.name);
        let names: Vec<String> = used().filter(|name| !is_there(name)).cloned().collect();
        match names.is_empty() {
            true => Ok(()),
            false => Err(ModelError::PhotosGone { path: scene.to_owned(), names, count: used().count() }),
        }
    }

    /// Looks for the photos on the disk that the model was trained and measured on, without decoding one. One that brings its
    /// photos, or was trained on a scene that the program made, needs none.
    ///
    /// # Errors
    /// [`ModelError::SceneGone`], [`ModelError::PhotosGone`]. The scene is not known or cannot be read.
    pub fn check_photos(&self) -> Result<(), ModelError> {
        if self.photos.is_some() || self.has_made_scene() {
            return Ok(());
        }
        let Some(path) = self.source.as_ref().or(self.config.source.as_ref()) else {
            return Err(ModelError::NoScene { path: self.path.clone() });
        };
        if !path.exists() {
            return Err(ModelError::SceneGone { path: path.clone() });
        }
        let scene = dataset::load_poses(path, &self.config.load_options())?;
        let names: HashSet<&str> = scene.views.iter().map(|(name, _)| &**name).collect();
        self.check_names(path, |name| names.contains(name))
    }

    /// Leaves the residual out: the base image alone is rendered, which needs no photo.
    pub fn without_residual(&mut self) {
        self.network = None;
        self.members.iter_mut().for_each(|member| member.network = None);
    }

    /// Gives the views of the scene the cameras of the model: refined by the training, or moved with it.
    fn give_cameras(&self, dataset: &mut Dataset) {
        let listed: HashMap<_, _> = self.cameras.iter().map(|record| (record.name.as_str(), record.camera)).collect();
        for view in &mut dataset.views {
            let size = |camera: &Camera| [camera.width, camera.height];
            let refined = listed.get(view.name.as_str()).filter(|camera| size(camera) == size(&view.camera));
            view.camera = refined.copied().unwrap_or(view.camera);
        }
    }

    /// Takes the scene to where the model has its cameras.
    fn move_scene(&self, dataset: &mut Dataset) {
        let own: HashMap<_, _> = dataset.views.iter().map(|view| (view.name.as_str(), view.camera)).collect();
        let pair = |record: &CameraRecord| Some((*own.get(record.name.as_str())?, record.camera));
        let pairs: Vec<_> = self.cameras.iter().filter_map(pair).collect();
        if !pairs.iter().all(|(from, to)| to.has_pose_of(from)) {
            let moved = Similarity::fit(&pairs);
            dataset.points.iter_mut().for_each(|point| point.position = moved.point(point.position));
            dataset.views.iter_mut().for_each(|view| view.camera = moved.camera(&view.camera));
        }
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

    /// The scene that the program makes, in the size that the model's cameras have.
    fn made_scene(&self, progress: &dyn Progress) -> Result<Dataset, ModelError> {
        let make = self.make_scene.ok_or_else(|| ModelError::NotMade { path: self.path.clone() })?;
        let width = self.cameras.first().ok_or(ModelError::NoCameras)?.camera.width;
        make(width, &self.config, progress).map_err(ModelError::Made)
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
