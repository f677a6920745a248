//! Why a model cannot be opened.

use crate::bundle::BundleError;
use crate::dataset::DatasetError;
use crate::exposure;
use crate::gpu::GpuError;
use crate::output::OutputError;
use crate::residual::NetworkError;
use crate::scene::SceneError;
use ibgs_data::first_of;
use std::path::PathBuf;
use thiserror::Error;

/// Why a model cannot be opened or put on a device.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// Its folder.
    #[error(transparent)]
    Folder(#[from] OutputError),
    /// Its bundle.
    #[error(transparent)]
    Bundle(#[from] BundleError),
    /// Its Gaussians.
    #[error(transparent)]
    Gaussians(#[from] SceneError),
    /// Its network.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// Its scene.
    #[error(transparent)]
    Scene(#[from] DatasetError),
    /// The folder of its scene is gone.
    #[error("the scene {}, whose photos the model needs, is not there any more", path.display())]
    SceneGone {
        /// Where it was.
        path: PathBuf,
    },
    /// Photos that the model was trained or measured on are not in its scene any more.
    #[error(
        "{} of the {count} photos of the model are not in its scene {} any more: {}", names.len(), path.display(), first_of(names, 3)
    )]
    PhotosGone {
        /// The scene.
        path: PathBuf,
        /// Their names.
        names: Vec<String>,
        /// Photos of the model.
        count: usize,
    },
    /// The scene that the program makes.
    #[error(transparent)]
    Made(Box<dyn std::error::Error + Send + Sync>),
    /// The program makes no scenes.
    #[error("{} was trained on a scene that the program made, which this one does not make", path.display())]
    NotMade {
        /// The model.
        path: PathBuf,
    },
    /// The device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A bundle has one iteration.
    #[error("{} holds iteration {found} alone, not {wanted}", path.display())]
    OtherIteration {
        /// The model.
        path: PathBuf,
        /// Its iteration.
        found: u32,
        /// The one asked for.
        wanted: u32,
    },
    /// A resolution was given for a model that knows its own.
    #[error("{} says itself which photos it was trained on", path.display())]
    KnowsItsPhotos {
        /// The model.
        path: PathBuf,
    },
    /// A file that is no bundle.
    #[error(
        "{} is no model: that is a folder, or a bundle in `.ibgs`; a file of Gaussians alone has no cameras and photos", path.display()
    )]
    OtherFile {
        /// The file.
        path: PathBuf,
    },
    /// A folder without a trained model.
    #[error("{} holds no point cloud", path.display())]
    NoPointCloud {
        /// The folder.
        path: PathBuf,
    },
    /// Its scene is not known.
    #[error("{} has no config.toml that names its scene", path.display())]
    NoScene {
        /// The folder.
        path: PathBuf,
    },
    /// Another scene than that of the training: photos are missing.
    #[error(
        "{} is not the scene of the model: {missing} of the {count} photos that its cameras.json lists are not there, \
         such as `{name}`", path.display()
    )]
    OtherScene {
        /// The scene given.
        path: PathBuf,
        /// Photos of the model that it lacks.
        missing: usize,
        /// Photos of the model.
        count: usize,
        /// Name of one that is missing.
        name: String,
    },
    /// Another scene than that of the training, or the same with other poses.
    #[error(
        "{} is not the scene of the model: its photos have the names that the model's cameras.json lists, but the \
         cameras stand elsewhere, that of `{name}` {distance:.3} units away", path.display()
    )]
    OtherPoses {
        /// The scene given.
        path: PathBuf,
        /// Name of a photo.
        name: String,
        /// Distance of its camera from that of the model.
        distance: f64,
    },
    /// An exposure is missing.
    #[error("the model's {} has no exposure of `{name}`", exposure::FILE_NAME)]
    NoExposure {
        /// Name of the photo.
        name: String,
    },
    /// A photo that the model was trained on is missing.
    #[error("the scene has no photo `{name}` any more")]
    NoPhoto {
        /// Its name.
        name: String,
    },
    /// A photo has changed.
    #[error("the photo `{name}` has another size than the model's camera; give the scene as it was trained")]
    PhotoSize {
        /// Its name.
        name: String,
    },
    /// The model folder lists no camera.
    #[error("the model has no cameras")]
    NoCameras,
}
