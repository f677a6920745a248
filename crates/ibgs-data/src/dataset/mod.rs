//! Posed photos from disk or from the built-in demo scene. Uses no GPU code.

mod archive;
mod backdrop;
mod colmap;
mod decode;
pub mod demo;
mod error;
mod fit;
mod host;
mod hull;
mod info;
mod kind;
mod lens;
mod llff;
mod masks;
mod names;
mod nerf;
mod neus;
mod notes;
mod npy;
mod options;
mod photos;
mod points;
mod points_ply;
mod reality_capture;
mod shown;
mod split;
mod undistort;

pub use archive::is_archive;
pub use colmap::{ModelFile, check_model_file};
pub(crate) use decode::srgb;
pub use decode::{decode_photo, photo_size};
pub use error::DatasetError;
pub use fit::{shown_by_any, unrelated_colors};
pub use host::HostPhoto;
pub use info::{CameraInfo, ModelInfo, SceneInfo, SizeInfo, SplitInfo};
pub use kind::SceneKind;
pub use llff::check_poses_bounds;
pub use masks::is_mask;
pub use names::{PHOTO_EXTENSIONS, has_extension, picture_extensions};
pub use neus::check_neus_cameras;
pub use options::{Alpha, ColorSpace, InitialPoints, LoadOptions, Masks, PrincipalPoint, Resampler, Resolution};
pub use photos::resample;
pub use points::thinned;
pub use reality_capture::check_reality_capture;
pub use shown::shown;

use crate::camera::Camera;
use crate::local_space::LocalSpace;
use crate::progress::Progress;
use archive::Unpacked;
use glam::DVec3;
use info::Beside;
use photos::ListedPhoto;
use rayon::prelude::*;
use split::StatedSplit;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Alpha where the photo of an object shows nothing.
pub const ALPHA_EMPTY: u8 = ibgs_shaders::ALPHA_EMPTY as u8;

/// An 8-bit photo, RGBA, row by row, sRGB values as stored in the file. Alpha 255 where the photo is valid; where the photos show an
/// object with nothing around it, it says how much of a pixel the object covers, from [`ALPHA_EMPTY`] to 255, and 0 is outside of the lens.
#[derive(Clone, Debug)]
pub struct Photo {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height * 4` bytes.
    pub rgba: Vec<u8>,
}

impl Photo {
    /// Whether no pixel has an alpha of one half or more: nothing can be compared with it.
    pub fn is_wholly_masked(&self) -> bool {
        self.rgba.chunks_exact(4).all(|pixel| pixel[3] < 128)
    }

    /// An object's photo composited over a background; opaque except where there is no photo.
    pub fn over(&self, background: [f32; 3]) -> Photo {
        let full = f32::from(u8::MAX - ALPHA_EMPTY);
        let pixel = |&[r, g, b, a]: &[u8; 4]| {
            if a < ALPHA_EMPTY {
                return [0; 4];
            }
            let cover = f32::from(a - ALPHA_EMPTY) / full;
            let channel = |c: usize| f32::from([r, g, b][c]) * cover + 255.0 * background[c] * (1.0 - cover);
            [channel(0).round() as u8, channel(1).round() as u8, channel(2).round() as u8, u8::MAX]
        };
        let rgba = self.rgba.as_chunks().0.iter().flat_map(pixel).collect();
        Photo { width: self.width, height: self.height, rgba }
    }
}

/// One posed photo.
#[derive(Clone, Debug)]
pub struct View {
    /// Image name as the scene file gives it, sub-folders and extension included, `/` as separator.
    pub name: String,
    /// Camera of the (undistorted, resized) photo.
    pub camera: Camera,
    /// The photo; its size equals the camera's.
    pub photo: HostPhoto,
}

/// One point of the initial cloud.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// World position.
    pub position: DVec3,
    /// 8-bit colour.
    pub color: [u8; 3],
}

impl Point {
    /// The same in local coordinates.
    pub fn to_local(self, space: &LocalSpace) -> Self {
        Self { position: space.to_local(self.position), ..self }
    }
}

/// Where initial points are from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PointsFrom {
    /// The scene's files.
    #[default]
    Scene,
    /// The visual hull of an object.
    Hull,
    /// The depths that photos agree on.
    Photos,
    /// Random ones stand in: nothing was asked of the photos yet.
    Chance,
    /// Random ones were asked for.
    Random,
}

/// A loaded scene in its own coordinates: views sorted by name, split, initial points.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Where it came from.
    pub path: PathBuf,
    /// All views, sorted by name.
    pub views: Vec<View>,
    /// Indices into `views` that train.
    pub train: Vec<usize>,
    /// Indices into `views` that are held out.
    pub test: Vec<usize>,
    /// Initial points (never empty: random points stand in, and `notes` says so).
    pub points: Vec<Point>,
    /// Where these are from.
    pub points_from: PointsFrom,
    /// Extent of the cameras in scene units, where it is given and not to be that of all views.
    pub extent: Option<f64>,
    /// What the photos' alpha means, where they show an object with nothing around it, and the colour to show it on.
    pub backdrop: Option<(Alpha, [u8; 3])>,
    /// What the user should know: rescaled intrinsics, skipped photos, random points ...
    pub notes: Vec<String>,
}

impl Dataset {
    /// The local coordinates for training and rendering. They follow from the cameras of all views of either split, or
    /// from the points if all cameras stand at one place.
    pub fn space(&self) -> LocalSpace {
        let cameras = self.views.iter().map(|view| &view.camera);
        LocalSpace::of_scene(cameras, self.points.iter().map(|point| point.position)).with_extent(self.extent)
    }

    /// The scene with some of its views, all of which train, and their photos made smaller: the longer side has at most `longest`
    /// pixels.
    ///
    /// # Errors
    /// A photo that cannot be decoded again.
    pub fn reduced(&self, views: &[usize], longest: u32) -> Result<Self, DatasetError> {
        let reduced = |&view: &usize| photos::reduced(&self.views[view], longest);
        let some = views.par_iter().map(reduced).collect::<Result<Vec<_>, DatasetError>>()?;
        Ok(Self { train: (0..some.len()).collect(), test: Vec::new(), views: some, ..self.clone() })
    }

    /// CRC-32 of what a training sees: names, cameras and photos of the training and the held-out views.
    pub fn checksum(&self) -> u32 {
        let one = |view: &View| {
            let mut sum = crc32fast::Hasher::new();
            let Camera { width, height, focal, principal, view_from_world, translation } = view.camera;
            sum.update(view.name.as_bytes());
            sum.update(&[width.to_le_bytes(), height.to_le_bytes()].concat());
            let columns = [view_from_world.x_axis, view_from_world.y_axis, view_from_world.z_axis, translation];
            let numbers = [focal, principal].map(|v| v.to_array()).concat().into_iter();
            numbers.chain(columns.map(|v| v.to_array()).concat()).for_each(|v| sum.update(&v.to_le_bytes()));
            sum.combine(&crc32fast::Hasher::new_with_initial_len(view.photo.checksum(), view.photo.bytes()));
            sum.finalize()
        };
        let sums: Vec<u32> = self.views.par_iter().map(one).collect();
        let mut all = crc32fast::Hasher::new();
        for part in [&self.train, &self.test] {
            part.iter().for_each(|&view| all.update(&sums[view].to_le_bytes()));
            all.update(b"|");
        }
        all.finalize()
    }
}

/// What the readers of the formats hand over: posed photos on disk, not decoded yet.
pub(crate) struct Scene {
    kind: SceneKind,
    /// The file that lists the images, for messages.
    listing: PathBuf,
    frames: Vec<ListedPhoto>,
    /// Listed photos that do not exist.
    missing: Vec<PathBuf>,
    /// Photos that are left out as their pose or camera is not a number; `notes` says so.
    unsolved: Vec<PathBuf>,
    points: Vec<Point>,
    /// Files that may hold the points, best first.
    point_files: Vec<PathBuf>,
    /// The split where the format states it.
    split: Option<StatedSplit>,
    /// Where photos without a pose may be.
    beside: Beside,
    notes: Vec<String>,
}

/// The points in the contents of a PLY file; `path` is for messages.
///
/// # Errors
/// [`DatasetError::Ply`] with line or byte.
pub fn parse_points_ply(path: &Path, bytes: &[u8]) -> Result<Vec<Point>, DatasetError> {
    Ok(points_ply::read(path, bytes)?.points)
}

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
    options.check()?;
    if !is_archive(path) {
        return load_folder(path, options, None, progress);
    }
    let unpacked = Arc::new(Unpacked::new(path)?);
    let loaded = load_folder(&unpacked.root(), options, Some(&unpacked), progress);
    let dataset = loaded.map_err(|error| unpacked.error(error))?;
    let notes = dataset.notes.iter().map(|note| unpacked.named(note)).collect();
    Ok(Dataset { path: path.to_owned(), notes, ..dataset })
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
    poses_in_folder(&unpacked.root(), options).map_err(|error| unpacked.error(error))
}

fn poses_in_folder(path: &Path, options: &LoadOptions) -> Result<PosedScene, DatasetError> {
    let (scene, root) = (read_sorted(path, options)?, root(path));
    let camera = |photo: &ListedPhoto| Ok((photo.name.clone(), photos::camera(photo, options)?));
    let views = scene.frames.par_iter().map(camera).collect::<Result<Vec<_>, DatasetError>>()?;
    let names: Vec<String> = views.iter().map(|(name, _)| name.clone()).collect();
    let split = split::divided(&names, scene.split, root, options)?;
    let (mut points, _) = points::own(scene.points, scene.point_files, root)?;
    points.retain(|point| point.position.is_finite());
    Ok(PosedScene { views, train: split.train, test: split.test, points })
}

/// The views of a scene by name, none twice.
fn read_sorted(path: &Path, options: &LoadOptions) -> Result<Scene, DatasetError> {
    let mut scene = match format_of(path)? {
        Format::Colmap => colmap::read(path, options)?,
        Format::Transforms => nerf::read(path, options)?,
        Format::RealityCapture => reality_capture::read(path, options)?,
        Format::Llff => llff::read(path, options)?,
        Format::Neus => neus::read(path, options)?,
    };
    check_photos(path, &scene)?;
    scene.frames.sort_by(|a, b| a.name.cmp(&b.name));
    if let Some(pair) = scene.frames.windows(2).find(|pair| pair[0].name == pair[1].name) {
        let name = pair[0].name.clone();
        return Err(DatasetError::DuplicateImage { path: scene.listing, name });
    }
    Ok(scene)
}

/// Loads a scene folder, which may be an unpacked archive.
fn load_folder(
    path: &Path,
    options: &LoadOptions,
    archive: Option<&Arc<Unpacked>>,
    progress: &dyn Progress,
) -> Result<Dataset, DatasetError> {
    let mut scene = read_sorted(path, options)?;
    let mut dataset = Dataset {
        path: path.to_owned(),
        views: Vec::new(),
        train: Vec::new(),
        test: Vec::new(),
        points: Vec::new(),
        points_from: PointsFrom::Scene,
        extent: options.extent,
        backdrop: None,
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
    let (alpha, color) = backdrop::meaning_of_alpha(&scene, options)?;
    let is_object = alpha.is_cover() || (scene.kind == SceneKind::Blender && options.masks == Masks::Object);
    dataset.backdrop = is_object.then_some((alpha, color));
    let options = &LoadOptions { alpha: Some(alpha), ..options.clone() };
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

/// Reads a scene's metadata, without its photos.
pub fn inspect(path: &Path) -> Result<SceneInfo, DatasetError> {
    if !is_archive(path) {
        return inspect_folder(path);
    }
    let unpacked = Unpacked::new(path)?;
    let inspected = inspect_folder(&unpacked.root());
    let info = inspected.map_err(|error| unpacked.error(error))?;
    let named = |texts: Vec<String>| texts.iter().map(|text| unpacked.named(text)).collect();
    let refused = info.refused.map(|refused| unpacked.named(&refused));
    Ok(SceneInfo { path: path.to_owned(), missing: named(info.missing), notes: named(info.notes), refused, ..info })
}

fn inspect_folder(path: &Path) -> Result<SceneInfo, DatasetError> {
    let inspected = match format_of(path)? {
        Format::Colmap => colmap::inspect(path),
        Format::Transforms => nerf::inspect(path),
        Format::RealityCapture => reality_capture::inspect(path),
        Format::Llff => llff::inspect(path),
        Format::Neus => neus::inspect(path),
    };
    info::complete(path, root(path), inspected?)
}

enum Format {
    Colmap,
    Transforms,
    RealityCapture,
    Llff,
    Neus,
}

fn format_of(path: &Path) -> Result<Format, DatasetError> {
    std::fs::metadata(path).map_err(|cause| DatasetError::read(path, &cause))?;
    if colmap::is_scene(path) {
        Ok(Format::Colmap)
    } else if nerf::is_scene(path) {
        Ok(Format::Transforms)
    } else if colmap::is_nerfstudio_scene(path) {
        Ok(Format::Colmap)
    } else if reality_capture::is_scene(path) {
        Ok(Format::RealityCapture)
    } else if llff::is_scene(path) {
        Ok(Format::Llff)
    } else if neus::is_scene(path) {
        Ok(Format::Neus)
    } else if colmap::is_flat_scene(path) {
        Ok(Format::Colmap)
    } else {
        Err(DatasetError::NotAScene { path: path.to_owned() })
    }
}

/// The scene folder, also where the path names a file in it.
fn root(path: &Path) -> &Path {
    match path.parent() {
        _ if path.is_dir() => path,
        Some(folder) if folder.as_os_str().is_empty() => Path::new("."),
        Some(folder) => folder,
        None => path,
    }
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
        (1, _) => Err(DatasetError::TooFewViews { path: path.to_owned(), count: 1, what: "views" }),
        _ => Ok(()),
    }
}
