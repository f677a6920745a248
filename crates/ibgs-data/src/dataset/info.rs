//! What a scene on disk holds, without decoding its photos.

use super::archive::{Unpacked, is_archive};
use super::decode::{Header, header};
use super::lens::Lens;
use super::names::{photos_below, photos_in};
use super::photos::ListedPhoto;
use super::split::{self, StatedSplit};
use super::{DatasetError, LoadOptions, Loaders, Scene, SceneKind, masks, notes, points, root};
use crate::first_of;
use glam::DVec2;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A camera as the scene file states it, before any resizing.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraInfo {
    /// The id in the file, or a running number where the format has none.
    pub id: String,
    /// Name of the camera model.
    pub model: String,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Focal lengths in pixels; none for a model that is not supported.
    pub focal: Option<DVec2>,
    /// Principal point in pixels; none for a model that is not supported.
    pub principal: Option<DVec2>,
    /// Whether photos are undistorted on load (or would have to be, for a model that is not supported).
    pub distorted: bool,
    /// Number of images that use it.
    pub images: usize,
}

/// A COLMAP model of a scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ModelInfo {
    /// Its folder inside the scene, such as `sparse/0`.
    pub folder: String,
    /// Number of images that it has a pose for.
    pub images: usize,
}

/// Photos of one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct SizeInfo {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Number of photos of this size.
    pub photos: usize,
}

/// What `eval` makes of the photos.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SplitInfo {
    /// Number of photos that train.
    pub train: usize,
    /// Number of photos that are held out.
    pub test: usize,
    /// What decides it.
    pub by: String,
}

/// What a scene on disk holds, without decoding its photos.
#[derive(Clone, Debug, Serialize)]
pub struct SceneInfo {
    /// Where it is.
    pub path: PathBuf,
    /// Format.
    pub kind: SceneKind,
    /// The file that lists the images, inside of `path`.
    pub listing: PathBuf,
    /// The COLMAP models of the scene, the one that is used first.
    pub models: Vec<ModelInfo>,
    /// Number of posed images listed, missing ones included.
    pub images: usize,
    /// Cameras.
    pub cameras: Vec<CameraInfo>,
    /// Number of initial points; 0 when random points would stand in.
    pub points: usize,
    /// Listed photos that do not exist.
    pub missing: Vec<String>,
    /// Photos beside the listed ones that have no pose, by their paths inside the scene.
    pub unposed: Vec<String>,
    /// Sizes of the listed photos, the most frequent first.
    pub sizes: Vec<SizeInfo>,
    /// Listed photos whose size cannot be read, by their paths inside the scene.
    pub unreadable: Vec<String>,
    /// Number of photos that have a mask in a file.
    pub masks: usize,
    /// The split with [`LoadOptions::eval`] and its default rule.
    pub split: SplitInfo,
    /// What the user should know, as [`Dataset::notes`](super::Dataset::notes) has it.
    pub notes: Vec<String>,
    /// Why the scene cannot be loaded, as far as that shows without decoding a photo.
    pub refused: Option<String>,
}

/// What a loader finds out without the photos.
#[derive(Debug)]
pub struct Inspected {
    pub(super) kind: SceneKind,
    pub(super) listing: PathBuf,
    pub(super) models: Vec<ModelInfo>,
    pub(super) images: usize,
    pub(super) cameras: Vec<CameraInfo>,
    pub(super) points: usize,
    pub(super) missing: Vec<String>,
    /// The photos that exist.
    pub(super) found: Vec<Found>,
    /// Photos that are left out as their pose or camera is not a number.
    pub(super) unsolved: Vec<PathBuf>,
    pub(super) beside: Beside,
    pub(super) split: Option<StatedSplit>,
    pub(super) notes: Vec<String>,
    pub(super) refused: Option<DatasetError>,
}

impl Inspected {
    /// What is known of a scene that was read.
    ///
    /// # Errors
    /// A file of points is damaged.
    pub(super) fn of(scene: Scene) -> Result<Self, DatasetError> {
        Ok(Self {
            kind: scene.kind,
            listing: scene.listing,
            models: Vec::new(),
            images: scene.frames.len() + scene.missing.len(),
            cameras: cameras(&scene.frames),
            points: points::from_files(&scene.point_files)?.map_or(scene.points.len(), |cloud| cloud.points.len()),
            missing: scene.missing.iter().map(|path| path.display().to_string()).collect(),
            found: scene.frames.into_iter().map(ListedPhoto::found).collect(),
            beside: scene.beside,
            split: scene.split,
            notes: scene.notes,
            unsolved: scene.unsolved,
            refused: None,
        })
    }
}

/// Frames with equal intrinsics count as one camera.
fn cameras(frames: &[ListedPhoto]) -> Vec<CameraInfo> {
    let mut cameras: Vec<(Lens, usize)> = Vec::new();
    for frame in frames {
        match cameras.iter_mut().find(|(lens, _)| *lens == frame.lens) {
            Some((_, images)) => *images += 1,
            None => cameras.push((frame.lens, 1)),
        }
    }
    let info = |(index, (lens, images)): (usize, &(Lens, usize))| CameraInfo {
        id: index.to_string(),
        model: match (lens.is_fisheye(), lens.distortion.is_none()) {
            (true, _) => "OPENCV_FISHEYE",
            (false, true) => "PINHOLE",
            (false, false) => "OPENCV",
        }
        .to_owned(),
        width: lens.width,
        height: lens.height,
        focal: Some(lens.focal),
        principal: Some(lens.principal),
        distorted: !lens.distortion.is_none(),
        images: *images,
    };
    cameras.iter().enumerate().map(info).collect()
}

/// A photo that exists.
#[derive(Debug)]
pub(crate) struct Found {
    pub name: String,
    pub photo: PathBuf,
    pub mask: Option<PathBuf>,
}

/// Where photos without a pose may be.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Beside {
    /// In a folder of photos, and in folders in it.
    Below(PathBuf),
    /// In the folders of the photos that have one.
    SameFolders,
    /// Nowhere: other pictures lie among the photos.
    Nowhere,
}

/// A path inside a folder, with `/`.
pub(crate) fn path_inside(root: &Path, path: &Path) -> String {
    let inside = path.strip_prefix(root).unwrap_or(path);
    inside.to_string_lossy().replace('\\', "/").replace(char::is_control, "?")
}

/// The photos on disk that have no pose, as paths inside `root`. A second file of a photo, such as the HEIC file beside a
/// JPEG of the same name, is none.
pub(crate) fn unposed<'a>(root: &Path, beside: &Beside, posed: impl Iterator<Item = &'a Path>) -> Vec<String> {
    let posed: BTreeSet<PathBuf> = posed.map(|photo| photo.with_extension("")).collect();
    let same_folders = || posed.iter().filter_map(|photo| photo.parent()).collect::<BTreeSet<_>>();
    let photos: Vec<PathBuf> = match beside {
        Beside::Below(folder) if folder != root => photos_below(folder),
        Beside::Below(_) | Beside::SameFolders => same_folders().into_iter().flat_map(photos_in).collect(),
        Beside::Nowhere => Vec::new(),
    };
    let is_posed = |photo: &Path| posed.contains(&photo.with_extension(""));
    let without = photos.iter().filter(|photo| !is_posed(photo) && !masks::is_mask(photo));
    without.map(|photo| path_inside(root, photo)).collect()
}

/// The first few of some names.
pub(crate) fn some_of(names: &[String]) -> String {
    first_of(names, 3)
}

/// What the headers of the photos say.
#[derive(Default)]
struct Headers {
    sizes: Vec<SizeInfo>,
    unreadable: Vec<String>,
    /// Photos that EXIF asks to turn.
    turned: Vec<String>,
    /// What is wrong with a mask, the first of such masks.
    refused: Option<DatasetError>,
}

impl Headers {
    fn read(root: &Path, found: &[Found]) -> Headers {
        let (mut headers, mut counts) = (Headers::default(), BTreeMap::<(u32, u32), usize>::new());
        // Several views may show one photo.
        let mut uses: BTreeMap<&Path, (usize, Option<&Path>)> = BTreeMap::new();
        found.iter().for_each(|one| uses.entry(&one.photo).or_insert((0, one.mask.as_deref())).0 += 1);
        for (photo, (count, mask)) in uses {
            let Ok(Header { size, is_turned }) = header(photo) else {
                headers.unreadable.push(path_inside(root, photo));
                continue;
            };
            *counts.entry(size).or_default() += count;
            headers.turned.extend(is_turned.then(|| path_inside(root, photo)));
            let shape = |mask| masks::check_shape((mask, header(mask)?.size), (photo, size));
            let refused = mask.and_then(|mask| shape(mask).err());
            headers.refused = headers.refused.or(refused);
        }
        let info = |((width, height), photos)| SizeInfo { width, height, photos };
        headers.sizes = counts.into_iter().map(info).collect();
        headers.sizes.sort_by_key(|size| std::cmp::Reverse(size.photos));
        headers
    }
}

/// Reads a scene's metadata, without its photos.
pub fn inspect(path: &Path) -> Result<SceneInfo, DatasetError> {
    if !is_archive(path) {
        return inspect_folder(path);
    }
    let unpacked = Unpacked::new(path)?;
    let inspected = inspect_folder(&unpacked.root(&Loaders::default()));
    let info = inspected.map_err(|error| unpacked.error(error))?;
    let named = |texts: Vec<String>| texts.iter().map(|text| unpacked.named(text)).collect();
    let refused = info.refused.map(|refused| unpacked.named(&refused));
    Ok(SceneInfo { path: path.to_owned(), missing: named(info.missing), notes: named(info.notes), refused, ..info })
}

fn inspect_folder(path: &Path) -> Result<SceneInfo, DatasetError> {
    complete(path, root(path), Loaders::default().of(path)?.inspect(path)?)
}

/// Adds what is the same for all formats.
fn complete(path: &Path, root: &Path, inspected: Inspected) -> Result<SceneInfo, DatasetError> {
    let Inspected { kind, listing, models, images, cameras, points, missing, found, beside, split, .. } = inspected;
    let listed = found.iter().map(|one| &one.photo).chain(&inspected.unsolved);
    let unposed = unposed(root, &beside, listed.map(PathBuf::as_path));
    let headers = Headers::read(root, &found);
    let masks = || found.iter().filter_map(|one| one.mask.as_deref());
    let mut notes = inspected.notes;
    notes.extend(masks::unfit_note(root, masks()));
    notes.extend(notes::turned(&headers.turned));
    let masks = masks().count();
    let mut names: Vec<String> = found.into_iter().map(|one| one.name).collect();
    names.sort();
    let options = LoadOptions { eval: true, ..LoadOptions::default() };
    let split = split::divided(&names, split, root, &options)?;
    Ok(SceneInfo {
        path: path.to_owned(),
        kind,
        listing: path_inside(root, &listing).into(),
        models,
        images,
        cameras,
        points,
        missing,
        unposed,
        sizes: headers.sizes,
        unreadable: headers.unreadable,
        masks,
        split: SplitInfo { train: split.train.len(), test: split.test.len(), by: split.by },
        notes,
        refused: inspected.refused.or(headers.refused).map(|error| error.to_string()),
    })
}
