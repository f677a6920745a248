//! The models of a scene: COLMAP writes one for each part that it could not join, `sparse/0`, `sparse/1` ...

use super::{CameraRecord, ImageRecord, SparsePoint, binary, text};
use crate::dataset::ModelInfo;
use crate::dataset::error::{DatasetError, read_bytes};
use crate::dataset::info::path_inside;
use glam::DVec2;
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Numbers of points, and where in the photo they are.
type Observations = Vec<(u64, DVec2)>;

/// Where a model lies and in which format.
pub(super) struct ModelFiles {
    pub folder: PathBuf,
    pub text: bool,
}

impl ModelFiles {
    /// The model in a folder that holds cameras and images; binary before text, as in 3DGS.
    pub fn of(folder: PathBuf) -> Option<ModelFiles> {
        let is_there = |extension: &str| {
            let holds = |stem: &str| folder.join(format!("{stem}.{extension}")).is_file();
            holds("cameras") && holds("images")
        };
        let text = [("bin", false), ("txt", true)].into_iter().find(|(extension, _)| is_there(extension))?.1;
        Some(ModelFiles { folder, text })
    }

    pub fn path(&self, stem: &str) -> PathBuf {
        let extension = if self.text { "txt" } else { "bin" };
        self.folder.join(format!("{stem}.{extension}"))
    }

    pub fn cameras(&self) -> Result<BTreeMap<u32, CameraRecord>, DatasetError> {
        let path = self.path("cameras");
        let bytes = read_bytes(&path)?;
        if self.text { text::cameras(&path, &bytes) } else { binary::cameras(&path, &bytes) }
    }

    pub fn images(&self) -> Result<Vec<ImageRecord>, DatasetError> {
        let path = self.path("images");
        let bytes = read_bytes(&path)?;
        Ok(if self.text { records(text::images(&path, &bytes)?) } else { records(binary::images(&path, &bytes)?) })
    }

    /// The observations of each image in its file's order.
    pub fn observations(&self) -> Result<Vec<(ImageRecord, Observations)>, DatasetError> {
        let path = self.path("images");
        let bytes = read_bytes(&path)?;
        if self.text {
            let images = text::images(&path, &bytes)?.into_iter();
            images.map(|(record, raw)| Ok((record, text::observations(&path, raw)?))).collect()
        } else {
            let images = binary::images(&path, &bytes)?.into_iter();
            Ok(images.map(|(record, raw)| (record, binary::observations(raw))).collect())
        }
    }

    /// The cloud; none where the file is absent.
    pub fn points(&self) -> Result<Vec<SparsePoint>, DatasetError> {
        let path = self.path("points3D");
        if !path.is_file() {
            return Ok(Vec::new());
        }
        let bytes = read_bytes(&path)?;
        if self.text { text::points(&path, &bytes) } else { binary::points(&path, &bytes) }
    }
}

/// The images without their observations.
pub(super) fn records<T>(images: Vec<(ImageRecord, T)>) -> Vec<ImageRecord> {
    images.into_iter().map(|(record, _)| record).collect()
}

/// The models in a folder: those of its numbered folders, by number, else its own.
pub(super) fn models_in(sparse: &Path) -> Vec<ModelFiles> {
    let entries = std::fs::read_dir(sparse).into_iter().flatten().flatten();
    let number = |path: PathBuf| Some((path.file_name()?.to_str()?.parse::<u32>().ok()?, path));
    let mut numbered: Vec<(u32, PathBuf)> = entries.filter_map(|entry| number(entry.path())).collect();
    numbered.sort();
    let models: Vec<ModelFiles> = numbered.into_iter().filter_map(|(_, folder)| ModelFiles::of(folder)).collect();
    if models.is_empty() { ModelFiles::of(sparse.to_owned()).into_iter().collect() } else { models }
}

/// The model that is used.
pub(super) struct Chosen {
    pub files: ModelFiles,
    pub images: Vec<ImageRecord>,
    /// All models of the scene, this one first.
    pub models: Vec<ModelInfo>,
}

/// The model with the most images, the lowest number among equals; none where there is no model.
///
/// # Errors
/// Any of the models is damaged: another one may be the largest.
pub(super) fn largest(scene: &Path, models: Vec<ModelFiles>) -> Result<Option<Chosen>, DatasetError> {
    let mut read = Vec::new();
    for files in models {
        read.push((files.images()?, files));
    }
    // Stable: models of one size stay in the order of their numbers.
    read.sort_by_key(|(images, _)| Reverse(images.len()));
    let info = |(images, files): &(Vec<ImageRecord>, ModelFiles)| {
        let folder = if files.folder == scene { ".".to_owned() } else { path_inside(scene, &files.folder) };
        ModelInfo { folder, images: images.len() }
    };
    let models = read.iter().map(info).collect();
    Ok(read.into_iter().next().map(|(images, files)| Chosen { files, images, models }))
}

/// Says which models there are, where there are several.
pub(super) fn note(models: &[ModelInfo]) -> Option<String> {
    let (used, others) = models.split_first().filter(|(_, others)| !others.is_empty())?;
    let others: Vec<String> = others.iter().map(|model| format!("{} with {}", model.folder, model.images)).collect();
    Some(format!(
        "the scene has {} COLMAP models that do not connect: {} with {} photos is used, not {}",
        models.len(),
        used.folder,
        used.images,
        others.join(", ")
    ))
}
