//! The formats of scenes: one loader each.

use super::info::{Beside, Inspected};
use super::lens::{Distortion, Lens, Pose};
use super::names::clean_name;
use super::photos::ListedPhoto;
use super::split::StatedSplit;
use super::{DatasetError, LOADERS, LoadOptions, Observations, Point};
use crate::camera::Camera;
use serde::{Serialize, Serializer};
use std::fmt;
use std::path::{Path, PathBuf};

/// Reads the scenes of one format.
pub trait Loader: fmt::Debug + Send + Sync {
    /// What shows the format, such as `poses_bounds.npy (LLFF)`: for the sentence about a folder that has nothing of the kind.
    fn shown_by(&self) -> &str;

    /// Whether a path, of a folder or a file, is a scene of the format.
    fn is_scene(&self, path: &Path) -> bool;

    /// Reads the views, in the order of the scene's files.
    ///
    /// # Errors
    /// What is wrong with the scene.
    fn read(&self, path: &Path, options: &LoadOptions) -> Result<Scene, DatasetError>;

    /// Reads the metadata alone.
    ///
    /// # Errors
    /// What is wrong with the scene.
    fn inspect(&self, path: &Path) -> Result<Inspected, DatasetError> {
        Inspected::of(self.read(path, &LoadOptions { eval: true, ..LoadOptions::default() })?)
    }

    /// Reads what the photos have of the points, where the format has it.
    ///
    /// # Errors
    /// What is wrong with the scene.
    fn observations(&self, _path: &Path, _options: &LoadOptions) -> Result<Observations, DatasetError> {
        Ok(Observations::default())
    }

    /// The files of the format that can be checked without the rest of a scene.
    fn files(&self) -> &'static [SceneFile] {
        &[]
    }
}

/// A file of a format, to be checked by itself.
#[derive(Clone, Copy, Debug)]
pub struct SceneFile {
    /// Its usual name.
    pub name: &'static str,
    /// Checks its contents and counts the records in them; the path is for messages.
    pub check: fn(&Path, &[u8]) -> Result<usize, DatasetError>,
}

/// The formats that scenes are read in: those of this crate, and those that a program adds.
#[derive(Clone, Debug)]
pub struct Loaders(Vec<&'static dyn Loader>);

impl Default for Loaders {
    fn default() -> Self {
        Self(LOADERS.to_vec())
    }
}

impl Loaders {
    /// These and another one, which is asked first.
    pub fn with(mut self, loader: &'static dyn Loader) -> Self {
        self.0.insert(0, loader);
        self
    }

    /// The files of all formats that can be checked by themselves.
    pub fn files(&self) -> Vec<SceneFile> {
        self.0.iter().flat_map(|loader| loader.files()).copied().collect()
    }

    /// The loader of a scene folder, or of the scene that a file stands for.
    pub(super) fn of(&self, path: &Path) -> Result<&'static dyn Loader, DatasetError> {
        std::fs::metadata(path).map_err(|cause| DatasetError::read(path, &cause))?;
        let found = self.0.iter().copied().find(|loader| loader.is_scene(path));
        found.ok_or_else(|| self.not_a_scene(path))
    }

    fn not_a_scene(&self, path: &Path) -> DatasetError {
        let wanted: Vec<String> = self.0.iter().map(|loader| format!("no {}", loader.shown_by())).collect();
        DatasetError::NotAScene { path: path.to_owned(), wanted: wanted.join(", ") }
    }
}

/// For a loader whose files went away while they were read.
pub(super) fn not_a_scene(path: &Path) -> DatasetError {
    Loaders::default().not_a_scene(path)
}

/// Format of a scene on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneKind {
    word: &'static str,
    name: &'static str,
}

impl SceneKind {
    /// A format by its word in JSON and its name in sentences.
    pub const fn new(word: &'static str, name: &'static str) -> Self {
        Self { word, name }
    }

    /// Its word in JSON.
    pub fn word(self) -> &'static str {
        self.word
    }
}

impl fmt::Display for SceneKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl Serialize for SceneKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.word)
    }
}

/// What a loader hands over: posed photos on disk, not decoded yet.
#[derive(Debug)]
pub struct Scene {
    pub(super) kind: SceneKind,
    /// The file that lists the images, for messages.
    pub(super) listing: PathBuf,
    pub(super) frames: Vec<ListedPhoto>,
    /// Listed photos that do not exist.
    pub(super) missing: Vec<PathBuf>,
    /// Photos that are left out as their pose or camera is not a number; `notes` says so.
    pub(super) unsolved: Vec<PathBuf>,
    pub(super) points: Vec<Point>,
    /// Files that may hold the points, best first.
    pub(super) point_files: Vec<PathBuf>,
    /// The split where the format states it.
    pub(super) split: Option<StatedSplit>,
    /// Where photos without a pose may be.
    pub(super) beside: Beside,
    /// Scenes of the format are objects with nothing around them, which figures of this field show on white.
    pub(super) of_objects: bool,
    pub(super) notes: Vec<String>,
}

/// A photo on disk and its camera, without distortion.
#[derive(Clone, Debug)]
pub struct PosedPhoto {
    /// Name of the view: a relative path with `/`.
    pub name: String,
    /// The file.
    pub file: PathBuf,
    /// Its camera, for the photo as the file has it.
    pub camera: Camera,
}

impl Scene {
    /// Photos and nothing else.
    pub(super) fn new(kind: SceneKind, listing: PathBuf, frames: Vec<ListedPhoto>) -> Self {
        Self {
            kind,
            listing,
            frames,
            missing: Vec::new(),
            unsolved: Vec::new(),
            points: Vec::new(),
            point_files: Vec::new(),
            split: None,
            beside: Beside::SameFolders,
            of_objects: false,
            notes: Vec::new(),
        }
    }

    /// A scene of photos that `listing` lists, with the points to begin with; without any, random ones stand in.
    ///
    /// # Errors
    /// A name that is no relative path, or a camera that is none.
    pub fn of_photos(
        kind: SceneKind,
        listing: PathBuf,
        photos: Vec<PosedPhoto>,
        points: Vec<Point>,
    ) -> Result<Self, DatasetError> {
        let frame = |PosedPhoto { name, file, camera }: PosedPhoto| {
            let Some(name) = clean_name(&name).filter(|name| !name.contains(char::is_control)) else {
                return Err(DatasetError::ImageName { path: listing.clone(), name });
            };
            let Camera { width, height, focal, principal, view_from_world, translation } = camera;
            let lens = Lens { width, height, focal, principal, distortion: Distortion::default() };
            if let Some(problem) = lens.problem() {
                return Err(DatasetError::Intrinsics { path: listing.clone(), camera: format!("`{name}`"), problem });
            }
            let pose = Pose::from_view(view_from_world, translation).map_err(|problem| DatasetError::Pose {
                path: listing.clone(),
                image: name.clone(),
                problem,
            })?;
            Ok(ListedPhoto { name, photo: file, mask: None, lens, pose, prescaled: false, key: None })
        };
        let frames = photos.into_iter().map(frame).collect::<Result<_, _>>()?;
        Ok(Self { points, ..Self::new(kind, listing, frames) })
    }
}
