//! COLMAP models, binary or text: `cameras`, `images`, `points3D` in `sparse/0`, `sparse/1` ... or `sparse`, or the same in
//! `colmap/`, or beside the photos.

mod binary;
mod models;
mod posed;
mod sparse;
mod text;
mod write;

pub use write::text_model;

use super::error::DatasetError;
use super::format::not_a_scene;
use super::info::{Beside, Found, Inspected};
use super::lens::{Distortion, Lens, Pose, Projection};
use super::masks::MaskFinder;
use super::names::{self, Inside, Photo, PhotoFolders, RelativeTo};
use super::photos::{AbsoluteNames, ListedPhoto};
use super::tracks::Observed;
use super::{CameraInfo, LoadOptions, Loader, Observations, Scene, SceneFile, SceneKind};
use glam::DVec2;
use models::{Chosen, ModelFiles};
use posed::{Unposed, Unsolved, posed};
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

/// Every model that COLMAP up to 4.1 writes: its number in binary files, name, number of parameters.
const MODELS: [(i32, &str, usize); 18] = [
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
    (12, "SIMPLE_DIVISION", 4),
    (13, "DIVISION", 5),
    (14, "SIMPLE_FISHEYE", 3),
    (15, "FISHEYE", 4),
    (16, "EUCM", 6),
    (17, "EQUIRECTANGULAR", 2),
];

/// COLMAP's models, where one of its layouts has them.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Colmap {
    /// COLMAP's own layout.
    Own,
    /// In the layout of nerfstudio, which has a `transforms.json` beside it as a rule.
    Nerfstudio,
    /// One model beside the photos, as RealityCapture exports it.
    Flat,
}

impl Colmap {
    /// The models in this layout.
    fn models(self, scene: &Path) -> Vec<ModelFiles> {
        match self {
            Colmap::Own => models::models_in(&scene.join("sparse")),
            Colmap::Nerfstudio => models::models_in(&scene.join("colmap/sparse")),
            Colmap::Flat => ModelFiles::of(scene.to_owned()).into_iter().collect(),
        }
    }

    /// The largest model.
    fn largest(self, scene: &Path) -> Result<Chosen, DatasetError> {
        models::largest(scene, self.models(scene))?.ok_or_else(|| not_a_scene(scene))
    }
}

/// The files of a model, by themselves.
const FILES: [SceneFile; 6] = [
    SceneFile { name: "cameras.bin", check: |path, bytes| check_cameras(path, binary::cameras(path, bytes)?) },
    SceneFile { name: "images.bin", check: check_binary_images },
    SceneFile { name: "points3D.bin", check: |path, bytes| Ok(binary::points(path, bytes)?.len()) },
    SceneFile { name: "cameras.txt", check: |path, bytes| check_cameras(path, text::cameras(path, bytes)?) },
    SceneFile { name: "images.txt", check: check_text_images },
    SceneFile { name: "points3D.txt", check: |path, bytes| Ok(text::points(path, bytes)?.len()) },
];

fn check_cameras(path: &Path, cameras: BTreeMap<u32, CameraRecord>) -> Result<usize, DatasetError> {
    cameras.iter().try_for_each(|(id, camera)| camera.lens(path, *id).map(|_| ()))?;
    Ok(cameras.len())
}

fn check_binary_images(path: &Path, bytes: &[u8]) -> Result<usize, DatasetError> {
    let images = binary::images(path, bytes)?;
    images.iter().for_each(|(_, raw)| drop(binary::observations(raw)));
    check_images(path, &models::records(images))
}

fn check_text_images(path: &Path, bytes: &[u8]) -> Result<usize, DatasetError> {
    let images = text::images(path, bytes)?;
    images.iter().try_for_each(|(_, raw)| text::observations(path, *raw).map(drop))?;
    check_images(path, &models::records(images))
}

fn check_images(path: &Path, images: &[ImageRecord]) -> Result<usize, DatasetError> {
    for image in images {
        names::inside(&image.name, |_| true).ok_or_else(|| image.bad_name(path))?;
        image.pose(path)?;
    }
    Ok(images.len())
}

impl ImageRecord {
    /// Its pose; `path` is for messages.
    fn pose(&self, path: &Path) -> Result<Pose, DatasetError> {
        Pose::from_colmap(self.quaternion, self.translation).map_err(|problem| DatasetError::Pose {
            path: path.to_owned(),
            image: self.name.clone(),
            problem,
        })
    }

    fn bad_name(&self, path: &Path) -> DatasetError {
        DatasetError::ImageName { path: path.to_owned(), name: self.name.clone() }
    }
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
        if self.model.ends_with("FISHEYE") {
            distortion.projection = Projection::Equidistant;
        }
        let (focal, principal) = match (self.model, self.params.as_slice()) {
            ("SIMPLE_PINHOLE" | "SIMPLE_FISHEYE", [f, cx, cy]) => ([*f; 2], [*cx, *cy]),
            ("PINHOLE" | "FISHEYE", [fx, fy, cx, cy]) => ([*fx, *fy], [*cx, *cy]),
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
                distortion.radial[0] = *k1;
                ([*f; 2], [*cx, *cy])
            }
            ("RADIAL_FISHEYE", [f, cx, cy, k1, k2]) => {
                distortion.radial[..2].copy_from_slice(&[*k1, *k2]);
                ([*f; 2], [*cx, *cy])
            }
            ("OPENCV_FISHEYE", [fx, fy, cx, cy, k1, k2, k3, k4]) => {
                distortion.radial = [*k1, *k2, *k3, *k4];
                ([*fx, *fy], [*cx, *cy])
            }
            ("THIN_PRISM_FISHEYE", [fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, s1, s2]) => {
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

fn beside(main: PathBuf) -> Beside {
    if main.is_dir() { Beside::Below(main) } else { Beside::SameFolders }
}

impl Loader for Colmap {
    fn shown_by(&self) -> &str {
        match self {
            Colmap::Own => "sparse/0/cameras.bin with images.bin (or .txt, or directly in sparse/)",
            Colmap::Nerfstudio => "such files in colmap/sparse/0/ (nerfstudio)",
            Colmap::Flat => "cameras.txt with images.txt (or .bin) beside the photos",
        }
    }

    fn is_scene(&self, path: &Path) -> bool {
        !self.models(path).is_empty()
    }

    fn files(&self) -> &'static [SceneFile] {
        match self {
            Colmap::Own => &FILES,
            // They have the same.
            Colmap::Nerfstudio | Colmap::Flat => &[],
        }
    }

    /// Reads the largest model and finds its photos.
    fn read(&self, scene: &Path, options: &LoadOptions) -> Result<Scene, DatasetError> {
        let Chosen { files, images, models } = self.largest(scene)?;
        let cameras = files.cameras()?;
        let folders = PhotoFolders::new(scene, RelativeTo::Photos, options);
        let (images_path, masks) = (files.path("images"), MaskFinder::new(scene));
        let (mut frames, mut missing, mut absolute) = (Vec::new(), Vec::new(), AbsoluteNames::default());
        let mut unsolved = Unsolved::default();
        for record in &images {
            let (inside, photo) = folders.resolve(&record.name).ok_or_else(|| record.bad_name(&images_path))?;
            let (pose, lens) = match posed(record, &cameras, &files) {
                Ok(posed) => posed,
                Err(Unposed::Unsolved(error)) => {
                    unsolved.add(&record.name, photo, error);
                    continue;
                }
                Err(Unposed::Wrong(error)) => return Err(error),
            };
            absolute.add(scene, &record.name, &inside);
            let name = inside.name;
            match photo {
                Photo::Found(photo, prescaled) => {
                    let mask = masks.find(&name, &photo);
                    frames.push(ListedPhoto { name, photo, mask, lens, pose, prescaled, key: None });
                }
                Photo::Missing(path) => missing.push(path),
            }
        }
        if let (true, true, Some(error)) = (frames.is_empty(), missing.is_empty(), unsolved.first.take()) {
            return Err(error);
        }
        let main = folders.main();
        if frames.is_empty() && !main.is_dir() {
            return Err(DatasetError::NoPhotoFolder { path: main });
        }
        let notes = models::note(&models).into_iter().chain(unsolved.note(&files)).chain(absolute.note());
        let mut notes: Vec<String> = notes.collect();
        notes.extend(folders.reduced_note());
        let mut points = files.points()?;
        if options.filter_points {
            points = sparse::reliable(points, &mut notes);
        }
        Ok(Scene {
            missing,
            unsolved: unsolved.photos,
            points: points.into_iter().map(|sparse| sparse.point).collect(),
            point_files: vec![files.folder.join("points3D.ply")],
            beside: beside(main),
            notes,
            ..Scene::new(kind(&files), images_path, frames)
        })
    }

    fn observations(&self, scene: &Path, options: &LoadOptions) -> Result<Observations, DatasetError> {
        let files = self.largest(scene)?.files;
        let (cameras, folders) = (files.cameras()?, PhotoFolders::new(scene, RelativeTo::Photos, options));
        let mut photos = Vec::new();
        for (record, points) in files.observations()? {
            // What has no pose is no view either.
            if let (Some((inside, _)), Ok((_, lens))) =
                (folders.resolve(&record.name), posed(&record, &cameras, &files))
            {
                photos.push(Observed { name: inside.name, lens, points });
            }
        }
        let positions = files.points()?.into_iter().map(|sparse| (sparse.id, sparse.point.position)).collect();
        Ok(Observations { photos, positions })
    }

    /// Metadata only; unsupported camera models and absent photos are reported, not refused.
    fn inspect(&self, scene: &Path) -> Result<Inspected, DatasetError> {
        let Chosen { files, images, models } = self.largest(scene)?;
        let cameras = files.cameras()?;
        let mut uses: BTreeMap<u32, usize> = BTreeMap::new();
        for image in &images {
            *uses.entry(image.camera).or_default() += 1;
        }
        let uses = |id: &u32| uses.get(id).copied().unwrap_or_default();
        let folders = PhotoFolders::new(scene, RelativeTo::Photos, &LoadOptions::default());
        let (mut found, mut missing, mut unsolved) = (Vec::new(), Vec::new(), Unsolved::default());
        let (mut refused, masks) = (None, MaskFinder::new(scene));
        for image in &images {
            let Some((Inside { name, .. }, photo)) = folders.resolve(&image.name) else {
                refused = refused.or_else(|| Some(image.bad_name(&files.path("images"))));
                missing.push(image.name.replace(char::is_control, "?"));
                continue;
            };
            match (posed(image, &cameras, &files), photo) {
                (Err(Unposed::Unsolved(error)), photo) => unsolved.add(&image.name, photo, error),
                (posed, photo) => {
                    if let Err(Unposed::Wrong(error)) = posed {
                        refused = refused.or(Some(error));
                    }
                    match photo {
                        Photo::Found(photo, _) => found.push(Found { mask: masks.find(&name, &photo), name, photo }),
                        Photo::Missing(_) => missing.push(image.name.replace(char::is_control, "?")),
                    }
                }
            }
        }
        if found.is_empty() && missing.is_empty() {
            refused = refused.or(unsolved.first.take());
        }
        Ok(Inspected {
            kind: kind(&files),
            listing: files.path("images"),
            models,
            images: images.len() - unsolved.count(),
            cameras: cameras.iter().map(|(id, camera)| camera.info(*id, uses(id))).collect(),
            points: files.points()?.len(),
            missing,
            found,
            notes: unsolved.note(&files).into_iter().collect(),
            unsolved: unsolved.photos,
            beside: beside(folders.main()),
            split: None,
            refused,
        })
    }
}

fn kind(files: &ModelFiles) -> SceneKind {
    match files.text {
        true => SceneKind::new("colmap_text", "COLMAP, text"),
        false => SceneKind::new("colmap_binary", "COLMAP, binary"),
    }
}
