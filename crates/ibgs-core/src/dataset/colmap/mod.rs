//! COLMAP models, binary or text: `cameras`, `images`, `points3D` in `sparse/0` or `sparse`.

mod binary;
mod sparse;
mod text;

use super::error::{DatasetError, read_bytes};
use super::lens::{Distortion, Lens, Pose, Projection};
use super::photos::{self, ListedPhoto, find_mask, find_photo};
use super::{CameraInfo, LoadOptions, Resolution, Scene, SceneKind};
use glam::DVec2;
use sparse::SparsePoint;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A camera as the file states it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CameraRecord {
    pub model: &'static str,
    pub width: u64,
    pub height: u64,
    pub params: Vec<f64>,
}

/// An image as the file states it: world-to-view quaternion `[w, x, y, z]` and translation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ImageRecord {
    pub name: String,
    pub camera: u32,
    pub quaternion: [f64; 4],
    pub translation: [f64; 3],
}

/// Every model that COLMAP writes: its number in binary files, name, number of parameters.
const MODELS: [(i32, &str, usize); 12] = [
    (0, "SIMPLE_PINHOLE", 3),
    (1, "PINHOLE", 4),
    (2, "SIMPLE_RADIAL", 4),
    (3, "RADIAL", 5),
    (4, "OPENCV", 8),
    (5, "OPENCV_FISHEYE", 8),
    (6, "FULL_OPENCV", 12),
    (7, "FOV", 5),
    (8, "SIMPLE_RADIAL_FISHEYE", 4),
    (9, "RADIAL_FISHEYE", 5),
    (10, "THIN_PRISM_FISHEYE", 12),
    (11, "RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

/// Where a model lies and in which format.
struct ModelFiles {
    folder: PathBuf,
    text: bool,
}

impl ModelFiles {
    /// The first of `sparse/0` and `sparse` that holds cameras and images; binary before text, as in 3DGS.
    fn find(scene: &Path) -> Option<ModelFiles> {
        let folders = [scene.join("sparse").join("0"), scene.join("sparse")];
        for folder in folders {
            for (extension, text) in [("bin", false), ("txt", true)] {
                let holds = |stem: &str| folder.join(format!("{stem}.{extension}")).is_file();
                if holds("cameras") && holds("images") {
                    return Some(ModelFiles { folder, text });
                }
            }
        }
        None
    }

    fn path(&self, stem: &str) -> PathBuf {
        let extension = if self.text { "txt" } else { "bin" };
        self.folder.join(format!("{stem}.{extension}"))
    }

    fn cameras(&self) -> Result<BTreeMap<u32, CameraRecord>, DatasetError> {
        let path = self.path("cameras");
        let bytes = read_bytes(&path)?;
        if self.text { text::cameras(&path, &bytes) } else { binary::cameras(&path, &bytes) }
    }

    fn images(&self) -> Result<Vec<ImageRecord>, DatasetError> {
        let path = self.path("images");
        let bytes = read_bytes(&path)?;
        if self.text { text::images(&path, &bytes) } else { binary::images(&path, &bytes) }
    }

    /// The cloud; none where the file is absent.
    fn points(&self) -> Result<Vec<SparsePoint>, DatasetError> {
        let path = self.path("points3D");
        if !path.is_file() {
            return Ok(Vec::new());
        }
        let bytes = read_bytes(&path)?;
        if self.text { text::points(&path, &bytes) } else { binary::points(&path, &bytes) }
    }
}

/// A file of a COLMAP model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelFile {
    /// `cameras.bin` or `cameras.txt`.
    Cameras,
    /// `images.bin` or `images.txt`.
    Images,
    /// `points3D.bin` or `points3D.txt`.
    Points,
}

/// Checks the contents of one file of a COLMAP model by itself, and counts its records; `path` is for messages, and its
/// extension distinguishes text (`txt`) from binary.
///
/// # Errors
/// A [`DatasetError`] that names the file and what is wrong in it.
pub fn check_model_file(file: ModelFile, path: &Path, bytes: &[u8]) -> Result<usize, DatasetError> {
    let is_text = path.extension().is_some_and(|extension| extension == "txt");
    Ok(match (file, is_text) {
        (ModelFile::Cameras, _) => {
            let cameras = if is_text { text::cameras(path, bytes) } else { binary::cameras(path, bytes) }?;
            cameras.iter().try_for_each(|(id, camera)| camera.lens(path, *id).map(|_| ()))?;
            cameras.len()
        }
        (ModelFile::Images, _) => {
            let images = if is_text { text::images(path, bytes) } else { binary::images(path, bytes) }?;
            images.iter().try_for_each(|image| image.place(path).map(|_| ()))?;
            images.len()
        }
        (ModelFile::Points, true) => text::points(path, bytes)?.len(),
        (ModelFile::Points, false) => binary::points(path, bytes)?.len(),
    })
}

impl ImageRecord {
    /// Its name inside the photo folder, and its pose; `path` is for messages.
    fn place(&self, path: &Path) -> Result<(String, Pose), DatasetError> {
        let (path, image) = (|| path.to_owned(), || self.name.clone());
        let name = photos::image_name(&self.name);
        let name = name.ok_or_else(|| DatasetError::ImageName { path: path(), name: image() })?;
        let pose = Pose::from_colmap(self.quaternion, self.translation);
        let pose = pose.map_err(|problem| DatasetError::Pose { path: path(), image: image(), problem })?;
        Ok((name, pose))
    }
}

/// Whether the folder holds a COLMAP model.
pub(crate) fn is_scene(scene: &Path) -> bool {
    ModelFiles::find(scene).is_some()
}

/// Name and number of parameters of a model; none for numbers that COLMAP does not have.
fn model_by_id(id: i32) -> Option<(&'static str, usize)> {
    MODELS.iter().find(|model| model.0 == id).map(|model| (model.1, model.2))
}

fn model_by_name(name: &str) -> Option<(&'static str, usize)> {
    MODELS.iter().find(|model| model.1 == name).map(|model| (model.1, model.2))
}

impl CameraRecord {
    /// Focal lengths, principal point and distortion, or none for a model that is not undistorted here.
    fn parameters(&self) -> Option<(DVec2, DVec2, Distortion)> {
        let mut distortion = Distortion::default();
        let (focal, principal) = match (self.model, self.params.as_slice()) {
            ("SIMPLE_PINHOLE", [f, cx, cy]) => ([*f; 2], [*cx, *cy]),
            ("PINHOLE", [fx, fy, cx, cy]) => ([*fx, *fy], [*cx, *cy]),
            ("SIMPLE_RADIAL", [f, cx, cy, k1]) => {
                distortion.radial[0] = *k1;
                ([*f; 2], [*cx, *cy])
            }
            ("RADIAL", [f, cx, cy, k1, k2]) => {
                distortion.radial[..2].copy_from_slice(&[*k1, *k2]);
                ([*f; 2], [*cx, *cy])
            }
            ("OPENCV", [fx, fy, cx, cy, k1, k2, p1, p2]) => {
                distortion.radial[..2].copy_from_slice(&[*k1, *k2]);
                distortion.tangential = [*p1, *p2];
                ([*fx, *fy], [*cx, *cy])
            }
            ("FULL_OPENCV", [fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
                distortion.radial[..3].copy_from_slice(&[*k1, *k2, *k3]);
                distortion.rational = [*k4, *k5, *k6];
                distortion.tangential = [*p1, *p2];
                ([*fx, *fy], [*cx, *cy])
            }
            ("SIMPLE_RADIAL_FISHEYE", [f, cx, cy, k1]) => {
                distortion.projection = Projection::Equidistant;
                distortion.radial[0] = *k1;
                ([*f; 2], [*cx, *cy])
            }
            ("RADIAL_FISHEYE", [f, cx, cy, k1, k2]) => {
                distortion.projection = Projection::Equidistant;
                distortion.radial[..2].copy_from_slice(&[*k1, *k2]);
                ([*f; 2], [*cx, *cy])
            }
            ("OPENCV_FISHEYE", [fx, fy, cx, cy, k1, k2, k3, k4]) => {
                distortion.projection = Projection::Equidistant;
                distortion.radial = [*k1, *k2, *k3, *k4];
                ([*fx, *fy], [*cx, *cy])
            }
            ("THIN_PRISM_FISHEYE", [fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, s1, s2]) => {
                distortion.projection = Projection::Equidistant;
                distortion.radial = [*k1, *k2, *k3, *k4];
                distortion.tangential = [*p1, *p2];
                distortion.prism = [*s1, *s2];
                ([*fx, *fy], [*cx, *cy])
            }
            ("FOV", [fx, fy, cx, cy, omega]) => {
                distortion.projection = Projection::Fov(*omega);
                ([*fx, *fy], [*cx, *cy])
            }
            _ => return None,
        };
        Some((DVec2::from_array(focal), DVec2::from_array(principal), distortion))
    }

    fn lens(&self, path: &Path, id: u32) -> Result<Lens, DatasetError> {
        let (path, camera) = (path.to_owned(), format!("camera {id}"));
        let Some((focal, principal, distortion)) = self.parameters() else {
            return Err(DatasetError::CameraModel { path, camera, model: self.model.to_owned() });
        };
        let (Ok(width), Ok(height)) = (u32::try_from(self.width), u32::try_from(self.height)) else {
            let problem = format!("the image size {} x {} is too large", self.width, self.height);
            return Err(DatasetError::Intrinsics { path, camera, problem });
        };
        let lens = Lens { width, height, focal, principal, distortion };
        match lens.problem() {
            Some(problem) => Err(DatasetError::Intrinsics { path, camera, problem }),
            None => Ok(lens),
        }
    }

    /// What is known without the photos; camera models that are not supported are listed too.
    fn info(&self, id: u32, images: usize) -> CameraInfo {
        let (focal, principal) = match self.parameters() {
            Some((focal, principal, _)) => (Some(focal), Some(principal)),
            None => (None, None),
        };
        CameraInfo {
            id: id.to_string(),
            model: self.model.to_owned(),
            width: u32::try_from(self.width).unwrap_or(u32::MAX),
            height: u32::try_from(self.height).unwrap_or(u32::MAX),
            focal,
            principal,
            distorted: !self.parameters().is_some_and(|(_, _, distortion)| distortion.is_none()),
            images,
        }
    }
}

/// The photo folder, and whether its photos are divided by the resolution factor already.
fn photo_folder(scene: &Path, options: &LoadOptions, notes: &mut Vec<String>) -> Result<(PathBuf, bool), DatasetError> {
    let named = options.images.as_deref().unwrap_or("images");
    if let (None, Some(reduced)) = (&options.images, reduced_folder(scene, options)) {
        notes.push(reduced_note(&reduced));
        return Ok((scene.join(reduced), true));
    }
    let path = scene.join(named);
    if path.is_dir() { Ok((path, false)) } else { Err(DatasetError::NoPhotoFolder { path }) }
}

/// `images_4` for factor 4, where the scene has it.
pub(crate) fn reduced_folder(scene: &Path, options: &LoadOptions) -> Option<String> {
    match options.resolution {
        Resolution::Factor(factor) if factor > 1 => {
            Some(format!("images_{factor}")).filter(|name| scene.join(name).is_dir())
        }
        _ => None,
    }
}

/// Says which resampler the photos went through.
pub(crate) fn reduced_note(folder: &str) -> String {
    format!("photos come from {folder} as they are, intrinsics rescaled to them")
}

/// Reads the model and finds its photos.
pub(crate) fn read(scene: &Path, options: &LoadOptions) -> Result<Scene, DatasetError> {
    let files = ModelFiles::find(scene).ok_or_else(|| not_a_scene(scene))?;
    let (cameras, images) = (files.cameras()?, files.images()?);
    let mut notes = Vec::new();
    let (folder, prescaled) = photo_folder(scene, options, &mut notes)?;
    let (cameras_path, images_path) = (files.path("cameras"), files.path("images"));
    let (mut frames, mut missing) = (Vec::new(), Vec::new());
    for record in &images {
        let (name, pose) = record.place(&images_path)?;
        let camera = cameras.get(&record.camera).ok_or_else(|| DatasetError::CameraNotFound {
            path: images_path.clone(),
            image: record.name.clone(),
            camera: record.camera,
        })?;
        let lens = camera.lens(&cameras_path, record.camera)?;
        match find_photo(&folder, &name) {
            Some(photo) => {
                let mask = find_mask(scene, &name);
                frames.push(ListedPhoto { name, photo, mask, lens, pose, prescaled });
            }
            None => missing.push(folder.join(name)),
        }
    }
    let mut points = files.points()?;
    if options.filter_points {
        points = sparse::reliable(points, &mut notes);
    }
    Ok(Scene {
        kind: kind(&files),
        listing: images_path,
        frames,
        missing,
        points: points.into_iter().map(|sparse| sparse.point).collect(),
        point_files: vec![files.folder.join("points3D.ply")],
        held_out: None,
        notes,
    })
}

fn kind(files: &ModelFiles) -> SceneKind {
    if files.text { SceneKind::ColmapText } else { SceneKind::ColmapBinary }
}

fn not_a_scene(scene: &Path) -> DatasetError {
    DatasetError::NotAScene { path: scene.to_owned() }
}

/// Metadata only; unsupported camera models and absent photos are reported, not refused.
pub(crate) fn inspect(scene: &Path) -> Result<super::SceneInfo, DatasetError> {
    let files = ModelFiles::find(scene).ok_or_else(|| not_a_scene(scene))?;
    let (cameras, images) = (files.cameras()?, files.images()?);
    let mut uses: BTreeMap<u32, usize> = BTreeMap::new();
    for image in &images {
        *uses.entry(image.camera).or_default() += 1;
    }
    let uses = |id: &u32| uses.get(id).copied().unwrap_or_default();
    let folder = scene.join("images");
    let is_missing =
        |image: &&ImageRecord| photos::image_name(&image.name).is_none_or(|name| find_photo(&folder, &name).is_none());
    Ok(super::SceneInfo {
        path: scene.to_owned(),
        kind: kind(&files),
        images: images.len(),
        cameras: cameras.iter().map(|(id, camera)| camera.info(*id, uses(id))).collect(),
        points: files.points()?.len(),
        missing: images.iter().filter(is_missing).map(|image| image.name.replace(char::is_control, "?")).collect(),
    })
}
