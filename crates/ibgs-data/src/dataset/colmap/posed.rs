//! Which images of a model have a pose and a camera. Programs write NaN for what they could not solve.

use super::models::ModelFiles;
use super::{CameraRecord, ImageRecord};
use crate::counted;
use crate::dataset::error::DatasetError;
use crate::dataset::info::some_of;
use crate::dataset::lens::{Lens, Pose};
use crate::dataset::names::Photo;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Why an image has no pose or no camera.
pub(super) enum Unposed {
    /// It was not solved: it is left out.
    Unsolved(DatasetError),
    /// The files are wrong.
    Wrong(DatasetError),
}

/// Pose and camera of an image.
pub(super) fn posed(
    image: &ImageRecord,
    cameras: &BTreeMap<u32, CameraRecord>,
    files: &ModelFiles,
) -> Result<(Pose, Lens), Unposed> {
    let images_path = files.path("images");
    let pose = image.pose(&images_path);
    let camera = cameras.get(&image.camera).ok_or_else(|| DatasetError::CameraNotFound {
        path: images_path,
        image: image.name.clone(),
        camera: image.camera,
    });
    let camera = camera.map_err(Unposed::Wrong)?;
    let lens = camera.lens(&files.path("cameras"), image.camera);
    let is_number = |values: &[f64]| values.iter().all(|value| value.is_finite());
    let is_pose = is_number(&image.quaternion) && is_number(&image.translation);
    let is_unsolved = !is_pose || (!is_number(&camera.params) && camera.parameters().is_some());
    match (pose, lens) {
        (Ok(pose), Ok(lens)) => Ok((pose, lens)),
        (Err(error), _) | (_, Err(error)) if is_unsolved => Err(Unposed::Unsolved(error)),
        (Err(error), _) | (_, Err(error)) => Err(Unposed::Wrong(error)),
    }
}

/// The images that were not solved.
#[derive(Default)]
pub(super) struct Unsolved {
    /// Files of those whose photo exists.
    pub photos: Vec<PathBuf>,
    names: Vec<String>,
    /// What is wrong with the first.
    pub first: Option<DatasetError>,
}

impl Unsolved {
    pub fn add(&mut self, name: &str, photo: Photo, error: DatasetError) {
        self.names.push(name.replace(char::is_control, "?"));
        if let Photo::Found(photo, _) = photo {
            self.photos.push(photo);
        }
        self.first.get_or_insert(error);
    }

    pub fn count(&self) -> usize {
        self.names.len()
    }

    pub fn note(&self, files: &ModelFiles) -> Option<String> {
        let (has, are) = if self.count() == 1 { ("has", "is") } else { ("have", "are") };
        let note = || {
            let listing = files.path("images");
            let listing = listing.file_name().unwrap_or_default().to_string_lossy();
            let (count, names) = (counted(self.count(), "photo"), some_of(&self.names));
            format!("{count} of {listing} {has} a pose or camera that is not a number and {are} left out: {names}")
        };
        (self.count() > 0).then(note)
    }
}
