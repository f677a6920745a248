//! Scenes are loaded: with their photos, or with cameras, split and points alone.

use super::archive::Unpacked;
use super::photos::ListedPhoto;
use super::{
    Alpha, Dataset, DatasetError, LoadOptions, Loaders, Masks, Point, PointsFrom, Scene, backdrop, info, is_archive,
    masks, notes, photos, points, root, split,
};
use crate::camera::Camera;
use crate::progress::Progress;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Loads a scene: poses, photos (undistorted, resized), split, initial points. `path` is a scene folder, a ZIP archive
/// of one, or a `transforms.json`.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Dataset, DatasetError> {
    load_with(path, options, &())
}

/// As [`load`]; `progress` receives the photos.
///
/// # Errors
/// As [`load`].
pub fn load_with(path: &Path, options: &LoadOptions, progress: &dyn Progress) -> Result<Dataset, DatasetError> {
    Loaders::default().load(path, options, progress)
}

impl Loaders {
    /// As [`load_with`], in these formats.
    ///
    /// # Errors
    /// As [`load`].
    pub fn load(&self, path: &Path, options: &LoadOptions, progress: &dyn Progress) -> Result<Dataset, DatasetError> {
        options.check()?;
        if !is_archive(path) {
            return load_scene(self.read_sorted(path, options)?, path, options, None, progress);
        }
        let unpacked = Arc::new(Unpacked::new(path)?);
        let root = unpacked.root(self);
        let scene = self.read_sorted(&root, options);
        let loaded = scene.and_then(|scene| load_scene(scene, &root, options, Some(&unpacked), progress));
        let dataset = loaded.map_err(|error| unpacked.error(error))?;
        let notes = dataset.notes.iter().map(|note| unpacked.named(note)).collect();
        Ok(Dataset { path: path.to_owned(), notes, ..dataset })
    }

    /// The views of a scene by name, none twice.
    fn read_sorted(&self, path: &Path, options: &LoadOptions) -> Result<Scene, DatasetError> {
        let mut scene = self.of(path)?.read(path, options)?;
        check_photos(path, &scene)?;
        scene.frames.sort_by(|a, b| a.name.cmp(&b.name));
        if let Some(pair) = scene.frames.windows(2).find(|pair| pair[0].name == pair[1].name) {
            let name = pair[0].name.clone();
            return Err(DatasetError::DuplicateImage { path: scene.listing, name });
        }
        Ok(scene)
    }
}

/// Loads what was read of a scene folder, which may be an unpacked archive.
fn load_scene(
    mut scene: Scene,
    path: &Path,
    options: &LoadOptions,
    archive: Option<&Arc<Unpacked>>,
    progress: &dyn Progress,
) -> Result<Dataset, DatasetError> {
    let mut dataset = Dataset {
        path: path.to_owned(),
        views: Vec::new(),
        train: Vec::new(),
        test: Vec::new(),
        points: Vec::new(),
        points_from: PointsFrom::Scene,
        extent: options.extent,
        masks: Masks::Ignore,
        backdrop: None,
        glossy: None,
        made_tracks: Arc::default(),
        loaded_checksum: None,
        notes: std::mem::take(&mut scene.notes),
    };
    dataset.notes.extend(notes::missing(&scene.missing, scene.frames.len()));
    let root = root(path);
    let listed = scene.frames.iter().map(|frame| &frame.photo).chain(&scene.unsolved);
    let unposed = info::unposed(root, &scene.beside, listed.map(PathBuf::as_path));
    dataset.notes.extend(notes::unposed(&unposed));
    dataset.notes.extend(masks::unfit_note(root, scene.frames.iter().filter_map(|frame| frame.mask.as_deref())));
    if let Some(split) = &options.split {
        split::keep_named(&mut scene.frames, split)?;
    }
    let (alpha, masks, color) = backdrop::meaning(&scene, options)?;
    let is_object = alpha.is_cover() || (scene.of_objects && masks == Masks::Object);
    dataset.backdrop = is_object.then_some((alpha, color));
    dataset.masks = masks;
    let options = &LoadOptions { alpha: Some(alpha), masks: Some(masks), ..options.clone() };
    if alpha == Alpha::Keyed {
        // Held-out photos stay as they are: figures compare with them.
        let names: Vec<String> = scene.frames.iter().map(|frame| frame.name.clone()).collect();
        let split = split::divided(&names, scene.split.clone(), root, options)?;
        split.train.iter().for_each(|&view| scene.frames[view].key = Some(color));
    }
    photos::load_views(scene.frames, (options, archive), progress, &mut dataset)?;
    split::split(&mut dataset, scene.split, root, options)?;
    points::fill(&mut dataset, scene.points, scene.point_files, root, options)?;
    Ok(dataset)
}

/// A scene without its photos: cameras in the size that the photos will have, split and points.
#[derive(Clone, Debug)]
pub struct PosedScene {
    /// Names and cameras of all views, sorted by name.
    pub views: Vec<(String, Camera)>,
    /// Indices into `views` that train.
    pub train: Vec<usize>,
    /// Indices into `views` that are held out.
    pub test: Vec<usize>,
    /// The scene's own points; none where random ones would stand in.
    pub points: Vec<Point>,
}

/// As [`load`], but of the photos only their sizes are read.
///
/// # Errors
/// As [`load`], but for photos that do not decode.
pub fn load_poses(path: &Path, options: &LoadOptions) -> Result<PosedScene, DatasetError> {
    options.check()?;
    if !is_archive(path) {
        return poses_in_folder(path, options);
    }
    let unpacked = Unpacked::new(path)?;
    poses_in_folder(&unpacked.root(&Loaders::default()), options).map_err(|error| unpacked.error(error))
}

fn poses_in_folder(path: &Path, options: &LoadOptions) -> Result<PosedScene, DatasetError> {
    let (scene, root) = (Loaders::default().read_sorted(path, options)?, root(path));
    let camera = |photo: &ListedPhoto| Ok((photo.name.clone(), photos::camera(photo, options)?));
    let views = scene.frames.par_iter().map(camera).collect::<Result<Vec<_>, DatasetError>>()?;
    let names: Vec<String> = views.iter().map(|(name, _)| name.clone()).collect();
    let split = split::divided(&names, scene.split, root, options)?;
    let (mut points, _) = points::own(scene.points, scene.point_files, root)?;
    points.retain(|point| point.position.is_finite());
    Ok(PosedScene { views, train: split.train, test: split.test, points })
}

/// Some photos may be missing, but at least two have to be there.
fn check_photos(path: &Path, scene: &Scene) -> Result<(), DatasetError> {
    match (scene.frames.len(), scene.missing.first()) {
        (0, None) => Err(DatasetError::NoImages { path: scene.listing.clone() }),
        (0, Some(first)) => Err(DatasetError::NoPhotos {
            path: scene.listing.clone(),
            count: scene.missing.len(),
            first: first.clone(),
        }),
        (1, _) => Err(DatasetError::TooFewViews { path: path.to_owned(), count: 1, what: "view" }),
        _ => Ok(()),
    }
}
