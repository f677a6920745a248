//! The scene that a model was trained on, loaded where its photos or cameras are needed.

use super::{Model, ModelError, scene_check};
use crate::camera::Camera;
use crate::config::{PoseSwitch, TrainConfig};
use crate::dataset::{self, Dataset};
use crate::output::cameras::{self, Split};
use crate::progress::Progress;
use std::collections::HashMap;
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
            Some(source) => {
                let found = load_scene(config, source, progress)?;
                if self.source.is_some() {
                    scene_check::check(&self.cameras, &found, source)?;
                }
                found
            }
            None if self.foreign => return Err(ModelError::NoScene { path: self.path.clone() }),
            None => self.made_scene(progress)?,
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
        if config.poses.refine != PoseSwitch::Off {
            self.give_cameras(&mut dataset);
        }
        Ok(dataset)
    }

    /// Gives the views of the scene the cameras that the training has refined.
    fn give_cameras(&self, dataset: &mut Dataset) {
        let listed: HashMap<_, _> = self.cameras.iter().map(|record| (record.name.as_str(), record.camera)).collect();
        for view in &mut dataset.views {
            let size = |camera: &Camera| [camera.width, camera.height];
            let refined = listed.get(view.name.as_str()).filter(|camera| size(camera) == size(&view.camera));
            view.camera = refined.copied().unwrap_or(view.camera);
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
