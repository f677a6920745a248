//! Posed photos from disk. Uses no GPU code.

mod archive;
mod backdrop;
mod cell_mask;
mod colmap;
mod decode;
mod error;
mod fit;
mod format;
mod host;
mod hull;
mod info;
mod lens;
mod llff;
mod load;
mod masks;
pub(crate) mod names;
mod nerf;
mod neus;
mod notes;
mod npy;
mod options;
mod outside;
mod photos;
mod points;
mod points_ply;
mod reality_capture;
mod shown;
mod split;
mod tracks;
mod undistort;

pub use archive::is_archive;
pub use cell_mask::CellMask;
pub use colmap::text_model as colmap_text;
pub(crate) use decode::srgb;
pub use decode::{decode_photo, photo_size};
pub use error::DatasetError;
pub use fit::{shown_by_any, unrelated_colors};
pub use format::{Loader, Loaders, PosedPhoto, Scene, SceneFile, SceneKind};
pub use host::HostPhoto;
pub use info::{CameraInfo, Inspected, ModelInfo, SceneInfo, SizeInfo, SplitInfo, inspect};
pub use load::{PosedScene, load, load_poses, load_with};
pub use masks::is_mask;
pub use names::{PHOTO_EXTENSIONS, has_extension, picture_extensions};
pub use options::{Alpha, ColorSpace, InitialPoints, LoadOptions, Masks, PrincipalPoint, Resampler, Resolution};
pub use photos::resample;
pub use points::thinned;
pub use shown::{median_depth, shown};
pub use tracks::Observations;

use crate::adjust::Track;
use crate::camera::Camera;
use crate::local_space::LocalSpace;
use glam::DVec3;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The formats of scenes, in the order in which they are asked.
const LOADERS: [&dyn Loader; 7] = [
    &colmap::Colmap::Own,
    &nerf::Transforms,
    &colmap::Colmap::Nerfstudio,
    &reality_capture::RealityCapture,
    &llff::Llff,
    &neus::Neus,
    &colmap::Colmap::Flat,
];

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
    /// What lies outside of the photos' masks.
    pub masks: Masks,
    /// What the photos' alpha means, where they show an object with nothing around it, and the colour to show it on.
    pub backdrop: Option<(Alpha, [u8; 3])>,
    /// Which pixels of a view, row by row, show something glossy or mirror-like: of a scene that was made and so is known.
    pub glossy: Option<fn(&Camera) -> Vec<bool>>,
    /// Which photos have which points, views by their numbers in `views`: of a scene that was made and so is known.
    pub made_tracks: Arc<[Track]>,
    /// The checksum of the scene as it was loaded, where its cameras were changed since.
    pub loaded_checksum: Option<u32>,
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
        Ok(Self {
            train: (0..some.len()).collect(),
            test: Vec::new(),
            views: some,
            made_tracks: Arc::default(),
            loaded_checksum: None,
            ..self.clone()
        })
    }

    /// CRC-32 of what a training loads: names, cameras and photos of the training and the held-out views.
    pub fn checksum(&self) -> u32 {
        if let Some(loaded) = self.loaded_checksum {
            return loaded;
        }
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

/// The points in the contents of a PLY file; `path` is for messages.
///
/// # Errors
/// [`DatasetError::Ply`] with line or byte.
pub fn parse_points_ply(path: &Path, bytes: &[u8]) -> Result<Vec<Point>, DatasetError> {
    Ok(points_ply::read(path, bytes)?.points)
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
