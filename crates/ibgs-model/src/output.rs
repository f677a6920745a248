//! The output folder of a training run: its layout, and who may write where.
//!
//! ```text
//! config.toml  cameras.json  split.json  input.ply
//! multi_view.json                                      sources of each view
//! point_cloud/iteration_N/point_cloud.ply
//! point_cloud/iteration_N/residual_network.safetensors from the first iteration with a residual on
//! point_cloud/iteration_N/exposure.json                where the photos' exposures were corrected
//! point_cloud/iteration_N/transients/NAME.png          learned masks of what moves in the training photos
//! point_cloud/iteration_N/member_M/                    the same of a further member of an ensemble, from 2
//! {test,train}/ours_N/OUTPUT/NAME.png                  OUTPUT: gt, renders, renders_aggregate, predicted_residual,
//!                                                      renders_depth, renders_normal, visibility
//! {test,train}/ours_N/exr/NAME.exr                     true values in place of pictures
//! path/ours_N/                                         frames of a camera path
//! mesh/ours_N/mesh.ply                                 triangle mesh
//! checkpoints/N.ibgs                                   what a training resumes from, while it runs or after it was stopped
//! results_renders.json  per_view_renders.json          scores of the base image
//! results_renders_aggregate.json  per_view_renders_aggregate.json
//!                                                      scores of the final image
//! result_training.json                                 time of the training
//! training_log.json                                    loss, PSNR and Gaussians over the training
//! result_fps_mem.json                                  speed, memory and storage, once measured
//! results_mesh.json                                    scores of the mesh, once measured
//! report.html                                          all of it to look at, once measured
//! ```
//! A folder of the published code has no `config.toml`, and its network in `color_aggregation_network.pth`.

pub mod cameras;
mod checkpoints;
mod error;
mod existing;
pub mod figures;
mod lock;
pub mod log;
pub mod multi_view;
pub mod pictures;
pub mod results;
mod transients;

pub use error::OutputError;
pub use existing::Existing;
pub use lock::FolderLock;

use crate::config::{Method, TrainConfig};
use crate::dataset::{Dataset, PHOTO_EXTENSIONS, has_extension};
use crate::ensemble;
use crate::exposure::{self, Exposure};
use crate::files::{self, WriteError};
use crate::residual::weights;
use crate::scene::write_points_ply;
use cameras::{CameraRecord, Split};
use multi_view::ViewSources;
use results::{Protocol, Scored, ViewScore};
use serde::Serialize;
use std::collections::HashMap;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

/// File of the report on a model.
pub const REPORT_FILE: &str = "report.html";

/// Extension of photo names that a picture's `.png` replaces, as it does those of [`PHOTO_EXTENSIONS`]: a scene may name BMP
/// files although its photos, which have the same names otherwise, are in another format.
const NAMED_EXTENSION: &str = "bmp";

/// The folder of one training run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputFolder {
    root: PathBuf,
}

impl OutputFolder {
    /// Opens the folder of a finished or interrupted run.
    ///
    /// # Errors
    /// [`OutputError::NoModel`] when no model was saved there, [`OutputError::Read`].
    pub fn open(path: &Path) -> Result<Self, OutputError> {
        let folder = Self { root: path.to_owned() };
        match folder.latest_iteration()? {
            Some(_) => Ok(folder),
            None => Err(OutputError::NoModel { path: path.to_owned() }),
        }
    }

    /// A folder for results; what is in it does not matter.
    pub fn at(path: &Path) -> Self {
        Self { root: path.to_owned() }
    }

    /// Where the residual network of an iteration is saved: beside the point cloud of the member, counted from 1.
    pub fn network_save_path(&self, iteration: u32, member: usize) -> PathBuf {
        self.member_path(iteration, member).with_file_name(weights::FILE_NAME)
    }

    /// Where the photos' exposures of an iteration are saved: beside the point cloud of the member, counted from 1.
    pub fn exposure_path(&self, iteration: u32, member: usize) -> PathBuf {
        self.member_path(iteration, member).with_file_name(exposure::FILE_NAME)
    }

    /// The point cloud of a member of an ensemble, counted from 1.
    pub fn member_path(&self, iteration: u32, member: usize) -> PathBuf {
        let first = self.point_cloud_path(iteration);
        match first.file_name() {
            Some(name) if member > 1 => first.with_file_name(ensemble::folder(member)).join(name),
            _ => first,
        }
    }

    /// Writes what a member, counted from 1, learned of the training photos' exposures, in the order of the training views.
    ///
    /// # Errors
    /// [`OutputError::Write`].
    pub fn write_exposures(
        &self,
        (iteration, member): (u32, usize),
        dataset: &Dataset,
        photos: &[Exposure],
    ) -> Result<(), OutputError> {
        let names = dataset.train.iter().map(|&view| dataset.views[view].name.as_str());
        Ok(write_json(&self.exposure_path(iteration, member), &exposure::to_json(names.zip(photos)))?)
    }

    /// Reads the photos' exposures of an iteration and a member, counted from 1, by name; none where none were corrected.
    ///
    /// # Errors
    /// [`OutputError::Read`], [`OutputError::Damaged`] naming the photo.
    pub fn read_exposures(
        &self,
        iteration: u32,
        member: usize,
    ) -> Result<Option<HashMap<String, Exposure>>, OutputError> {
        let path = self.exposure_path(iteration, member);
        match fs::read_to_string(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(OutputError::Read { path, source }),
            Ok(text) => exposure::from_json(&text).map(Some).map_err(|reason| OutputError::Damaged { path, reason }),
        }
    }

    /// The residual network of an iteration, ours or the published code's; none where there is none. Of an ensemble that of the first.
    pub fn network_path(&self, iteration: u32) -> Option<PathBuf> {
        let beside = self.network_save_path(iteration, 1);
        let published = beside.with_file_name(weights::PUBLISHED_FILE_NAME);
        let at_root = self.root.join(weights::PUBLISHED_FILE_NAME);
        [beside, published, at_root].into_iter().find(|path| path.is_file())
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// `config.toml`.
    pub fn config_path(&self) -> PathBuf {
        self.root.join("config.toml")
    }

    /// `cameras.json`.
    pub fn cameras_path(&self) -> PathBuf {
        self.root.join("cameras.json")
    }

    /// `split.json`.
    pub fn split_path(&self) -> PathBuf {
        self.root.join("split.json")
    }

    /// `point_cloud/iteration_N/point_cloud.ply`; the PLY writer makes the folders.
    pub fn point_cloud_path(&self, iteration: u32) -> PathBuf {
        self.root.join("point_cloud").join(format!("iteration_{iteration}")).join("point_cloud.ply")
    }

    /// `mesh/ours_N/NAME`.
    pub fn mesh_path(&self, iteration: u32, name: &str) -> PathBuf {
        self.root.join("mesh").join(format!("ours_{iteration}")).join(name)
    }

    /// `test/ours_N/OUTPUT/NAME.png` (or `train/...`), with the sub-folders of the photo's name and `.png` in place of
    /// its extension. Parts of the name that lead out of the folder are left out.
    pub fn picture_path(&self, split: Split, iteration: u32, output: &str, name: &str) -> PathBuf {
        let mut path = self.root.join(split.folder());
        path.push(format!("ours_{iteration}"));
        path.push(output);
        named_picture(path, name)
    }

    /// The largest N with a `point_cloud/iteration_N/point_cloud.ply`, or `None`.
    ///
    /// # Errors
    /// As [`OutputFolder::iterations`].
    pub fn latest_iteration(&self) -> Result<Option<u32>, OutputError> {
        Ok(self.iterations()?.last().copied())
    }

    /// Every N with a `point_cloud/iteration_N/point_cloud.ply`, in order.
    ///
    /// # Errors
    /// [`OutputError::Read`] when the folder cannot be listed; a missing one has no iteration.
    pub fn iterations(&self) -> Result<Vec<u32>, OutputError> {
        let numbered = self.numbered("point_cloud", "iteration_", "")?;
        let saved = numbered.into_iter().filter(|(_, path)| path.join("point_cloud.ply").is_file());
        let mut iterations: Vec<u32> = saved.map(|(iteration, _)| iteration).collect();
        iterations.sort_unstable();
        Ok(iterations)
    }

    /// Writes what is known before training: `config.toml`, `cameras.json`, `split.json`, `input.ply`, and where photos of
    /// neighbouring views are used `multi_view.json`.
    ///
    /// # Errors
    /// The first file that cannot be written.
    pub fn write_start(&self, config: &TrainConfig, dataset: &Dataset) -> Result<(), OutputError> {
        config.save(&self.config_path())?;
        self.write_cameras(dataset)?;
        write_json(&self.split_path(), &cameras::split_json(&cameras::records(dataset)))?;
        write_points_ply(&self.root.join("input.ply"), &dataset.points, dataset.space())?;
        if config.method == Method::Ibgs {
            self.write_multi_view(&multi_view::records(dataset, &config.sources))?;
        }
        Ok(())
    }

    /// Writes `cameras.json`.
    ///
    /// # Errors
    /// [`OutputError::Write`].
    pub fn write_cameras(&self, dataset: &Dataset) -> Result<(), OutputError> {
        Ok(write_json(&self.cameras_path(), &cameras::to_json(&cameras::records(dataset)))?)
    }

    /// Reads `config.toml`.
    ///
    /// # Errors
    /// [`OutputError::Config`] naming file and field.
    pub fn read_config(&self) -> Result<TrainConfig, OutputError> {
        Ok(TrainConfig::load(&self.config_path())?)
    }

    /// Reads `cameras.json`: the cameras exactly as they were written. Files of other programs in the form of 3D
    /// Gaussian splatting (without `cx`, `cy`, `translation`, `split`) load too, with centred principal points.
    ///
    /// # Errors
    /// [`OutputError::Read`], [`OutputError::Damaged`] naming line or camera.
    pub fn read_cameras(&self) -> Result<Vec<CameraRecord>, OutputError> {
        cameras::read(&self.cameras_path())
    }

    /// Writes the sources of each view to `multi_view.json`.
    ///
    /// # Errors
    /// [`OutputError::Write`].
    pub fn write_multi_view(&self, views: &[ViewSources]) -> Result<(), OutputError> {
        let write = |out: &mut dyn io::Write| out.write_all(multi_view::to_text(views)?.as_bytes());
        Ok(files::write_atomically(&self.root.join("multi_view.json"), write)?)
    }

    /// Reads `multi_view.json`.
    ///
    /// # Errors
    /// [`OutputError::Read`], [`OutputError::Damaged`] naming the line.
    pub fn read_multi_view(&self) -> Result<Vec<ViewSources>, OutputError> {
        let path = self.root.join("multi_view.json");
        let text = fs::read_to_string(&path).map_err(|source| OutputError::Read { path: path.clone(), source })?;
        multi_view::from_text(&text).map_err(|reason| OutputError::Damaged { path, reason })
    }

    /// Adds the scores of the base or the final image at `iteration` to `results_renders.json` and
    /// `per_view_renders.json` (`.._renders_aggregate.json` for the final image), which keep their other iterations. Each
    /// mean runs over all views; LPIPS is `null` until it is measured, and so is a mean that is not finite (the PSNR of
    /// equal images).
    ///
    /// # Errors
    /// [`OutputError::Damaged`] when a results file that is there is no JSON object, [`OutputError::Write`].
    pub fn write_results(
        &self,
        iteration: u32,
        scored: Scored,
        scores: &[ViewScore],
        protocol: &Protocol,
    ) -> Result<(), OutputError> {
        let [summary, per_view] = scored.files();
        self.write_result(iteration, summary, results::summary(scores, protocol))?;
        self.write_result(iteration, per_view, results::per_view(scores))
    }

    /// Adds what was measured at `iteration` to a results file, which keeps its other iterations.
    ///
    /// # Errors
    /// [`OutputError::Damaged`] when the file is there and no JSON object, [`OutputError::Write`].
    pub fn write_result(&self, iteration: u32, file: &str, value: serde_json::Value) -> Result<(), OutputError> {
        let path = self.root.join(file);
        let mut all = read_object(&path)?;
        all.insert(format!("ours_{iteration}"), value);
        Ok(write_json(&path, &all)?)
    }

    /// Entries `PREFIX<number>SUFFIX` of a folder, with their numbers.
    fn numbered(&self, folder: &str, prefix: &str, suffix: &str) -> Result<Vec<(u32, PathBuf)>, OutputError> {
        let path = self.root.join(folder);
        let list = || -> io::Result<Vec<(u32, PathBuf)>> {
            let entries = match fs::read_dir(&path) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
                entries => entries?,
            };
            let mut found = Vec::new();
            for entry in entries {
                let entry = entry?;
                let name = entry.file_name();
                let number =
                    name.to_str().and_then(|name| name.strip_prefix(prefix)?.strip_suffix(suffix)?.parse().ok());
                found.extend(number.map(|number| (number, entry.path())));
            }
            Ok(found)
        };
        list().map_err(|source| OutputError::Read { path: path.clone(), source })
    }
}

/// The picture of a photo of this name in a folder: with the name's sub-folders, and `.png` in place of its extension. Parts of the
/// name that lead out of the folder are left out.
fn named_picture(mut path: PathBuf, name: &str) -> PathBuf {
    for component in Path::new(name).components() {
        if let Component::Normal(part) = component {
            path.push(part);
        }
    }
    // `frame.0001` has no extension that could be replaced.
    let photo = has_extension(&path, &PHOTO_EXTENSIONS) || has_extension(&path, &[NAMED_EXTENSION]);
    if photo {
        path.set_extension("");
    }
    path.as_mut_os_string().push(".png");
    path
}

pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), WriteError> {
    files::write_atomically(path, |out| {
        serde_json::to_writer_pretty(&mut *out, value).map_err(io::Error::from)?;
        out.write_all(b"\n")
    })
}

/// The JSON object in a file; a missing file is an empty one.
fn read_object(path: &Path) -> Result<serde_json::Map<String, serde_json::Value>, OutputError> {
    let text = match fs::read_to_string(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Default::default()),
        Err(source) => {
            return Err(OutputError::Read { path: path.to_owned(), source });
        }
        Ok(text) => text,
    };
    serde_json::from_str(&text)
        .map_err(|error| OutputError::Damaged { path: path.to_owned(), reason: error.to_string() })
}
