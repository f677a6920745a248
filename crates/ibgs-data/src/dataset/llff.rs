//! LLFF's `poses_bounds.npy`: a row of 17 numbers a photo, the photos in the order of their names.
//!
//! A row is a matrix of 3 x 5, row by row, and the nearest and farthest depth. The columns of the matrix are the axes of the
//! camera in the world, down, right and backward, its place, and height, width and focal length in pixels. They are of the
//! photos in `images/`; those in `images_4/` and the like are smaller. The depths are not used.

use super::error::{DatasetError, read_bytes};
use super::format::not_a_scene;
use super::lens::{Distortion, Lens, Pose};
use super::masks::MaskFinder;
use super::names::{PhotoFolders, RelativeTo, inside, photos_in};
use super::photos::ListedPhoto;
use super::{LoadOptions, Loader, Scene, SceneFile, SceneKind, npy};
use glam::DVec2;
use std::path::{Path, PathBuf};

const FILE: &str = "poses_bounds.npy";
/// Numbers of a row: the matrix and two depths.
const ROW: usize = 17;

/// The file of a folder, or the file itself.
fn listing(scene: &Path) -> Option<PathBuf> {
    let path = if scene.is_file() { scene.to_owned() } else { scene.join(FILE) };
    let is_array = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npy"));
    Some(path).filter(|path| is_array && path.is_file())
}

/// The lens and the pose in a row.
fn camera(row: &[f64]) -> Result<(Lens, Pose), String> {
    if row[..15].iter().any(|v| !v.is_finite()) {
        return Err("the pose is not finite".to_owned());
    }
    let at = |r: usize, column: usize| row[5 * r + column];
    let [height, width, focal] = [0, 1, 2].map(|r| at(r, 4));
    let side = |v: f64| (1.0..=f64::from(u32::MAX)).contains(&v).then_some(v.round() as u32);
    let (Some(w), Some(h)) = (side(width), side(height)) else {
        return Err(format!("the image size {width} x {height} is not a number of pixels"));
    };
    let lens = Lens {
        width: w,
        height: h,
        focal: DVec2::splat(focal),
        principal: DVec2::new(width, height) / 2.0,
        distortion: Distortion::default(),
    };
    if let Some(problem) = lens.problem() {
        return Err(problem);
    }
    let rows: Vec<Vec<f64>> = (0..3).map(|r| vec![at(r, 1), -at(r, 0), at(r, 2), at(r, 3)]).collect();
    Ok((lens, Pose::from_opengl(&rows)?))
}

/// The cameras in the contents of a file.
fn cameras(path: &Path, bytes: &[u8]) -> Result<Vec<(Lens, Pose)>, DatasetError> {
    let bad = |place: String, problem: String| DatasetError::Format { path: path.to_owned(), place, problem };
    let array = npy::parse(bytes).map_err(|problem| bad("array".to_owned(), problem))?;
    if !matches!(array.shape[..], [_, ROW]) {
        let problem = format!("it has the shape {:?} where a row of {ROW} numbers a photo is needed", array.shape);
        return Err(bad("array".to_owned(), problem));
    }
    let rows = array.values.chunks_exact(ROW).enumerate();
    rows.map(|(index, row)| camera(row).map_err(|problem| bad(format!("row {index}"), problem))).collect()
}

/// Names of the photos. Reduced photos often have other names than those in `images/`, which then count.
fn names(root: &Path, photos: &[PathBuf], is_reduced: bool) -> Vec<String> {
    let full = if is_reduced { photos_in(&root.join("images")) } else { Vec::new() };
    let named = if full.len() == photos.len() { &full } else { photos };
    named.iter().map(|path| path.file_name().unwrap_or_default().to_string_lossy().into_owned()).collect()
}

/// Such a file, or a folder with one.
#[derive(Debug)]
pub(crate) struct Llff;

impl Loader for Llff {
    fn shown_by(&self) -> &str {
        "poses_bounds.npy (LLFF)"
    }

    fn is_scene(&self, path: &Path) -> bool {
        listing(path).is_some()
    }

    fn files(&self) -> &'static [SceneFile] {
        &[SceneFile { name: FILE, check: |path, bytes| Ok(cameras(path, bytes)?.len()) }]
    }

    /// Reads the poses and finds the photos.
    fn read(&self, scene: &Path, options: &LoadOptions) -> Result<Scene, DatasetError> {
        let listing = listing(scene).ok_or_else(|| not_a_scene(scene))?;
        let root = super::root(&listing).to_owned();
        let folders = PhotoFolders::new(&root, RelativeTo::Photos, options);
        let folder = folders.main();
        if !folder.is_dir() {
            return Err(DatasetError::NoPhotoFolder { path: folder });
        }
        let cameras = cameras(&listing, &read_bytes(&listing)?)?;
        let photos = photos_in(&folder);
        if photos.len() != cameras.len() {
            let (poses, photos) = (cameras.len(), photos.len());
            return Err(DatasetError::PoseCount { path: listing, folder, poses, photos });
        }
        let names = names(&root, &photos, folders.is_reduced());
        let mut frames = Vec::with_capacity(photos.len());
        let masks = MaskFinder::new(&root);
        for ((photo, name), (lens, pose)) in photos.into_iter().zip(names).zip(cameras) {
            if inside(&name, |_| true).is_none() {
                return Err(DatasetError::ImageName { path: listing, name });
            }
            let mask = masks.find(&name, &photo);
            frames.push(ListedPhoto { name, photo, mask, lens, pose, prescaled: folders.is_reduced(), key: None });
        }
        let kind = SceneKind::new("llff", "LLFF");
        Ok(Scene { notes: folders.reduced_note().into_iter().collect(), ..Scene::new(kind, listing, frames) })
    }
}
