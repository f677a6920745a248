//! The built-in demo scene: a furnished room with a lacquered sphere, a mirror ball and a golden ring, ray traced on the
//! CPU when first needed and cached on disk as a nerfstudio scene folder.
//!
//! Everything is a pure function of [`DemoOptions`]: no clock, no thread order and no libm enters a pixel, so two
//! machines trace the same bytes. World axes: z up, metres, floor at z = 0.

mod cache;
mod cloud;
mod exposure;
mod figure;
mod mesh;
mod numeric;
mod poses;
mod scene;
mod shape;
mod street;
mod texture;
mod trace;
mod tracks;
mod walkers;

use cache::Cache;
use glam::DVec3;
use ibgs_data::camera::Camera;
use ibgs_data::dataset::{Dataset, DatasetError, Masks, Photo, Point, PointsFrom, View};
use ibgs_data::progress::Progress;
use serde::Serialize;
use std::path::{Path, PathBuf};

pub use exposure::change_exposure;
pub use mesh::{TriangleMesh, mesh};
pub use poses::{cameras, look_at};
pub use scene::{BALL, CUBE, GLOSSY_SPHERE, LAMP, MIRROR, RING, ROOM, STAND, TABLE, is_view_dependent};
pub use street::{StreetOptions, street};
pub use trace::{Truth, render_photo, truth};
pub use walkers::{Walked, WalkerMask, WalkerOptions, WalkerPixel, walkers};

/// Version of the scene; any change to a traced pixel, a pose or a point raises it, and old caches are left behind.
pub const VERSION: u32 = 2;

/// Every view whose index by name is a multiple of this is held out.
const TEST_EVERY: usize = 8;

/// Size and richness of the demo scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DemoOptions {
    /// Photo width in pixels.
    pub width: u32,
    /// Photo height in pixels.
    pub height: u32,
    /// Number of photos, held-out ones included.
    pub views: usize,
    /// Rays a pixel along each side of the pixel (4 means 16 rays).
    pub samples: u32,
    /// Number of initial points, outliers included.
    pub points: usize,
    /// Seed of the camera jitter and of the points; the scene itself is always the same.
    pub seed: u64,
}

impl DemoOptions {
    /// For a software adapter: 40 photos of 160 x 120 pixels and 6,000 points, traced in seconds.
    pub fn small() -> Self {
        DemoOptions { width: 160, height: 120, views: 40, samples: 4, points: 6_000, seed: 0 }
    }

    /// For a GPU: 120 photos of 640 x 480 pixels and 40,000 points, traced in minutes on two cores.
    pub fn large() -> Self {
        DemoOptions { width: 640, height: 480, views: 120, samples: 3, points: 40_000, seed: 0 }
    }

    /// Name of the folder that keeps the scene.
    fn folder_name(&self) -> String {
        let DemoOptions { width, height, views, samples, points, seed } = self;
        format!("demo-v{VERSION}-{width}x{height}-{views}v-{samples}s-{points}p-{seed}")
    }

    fn validate(&self) -> Result<(), DemoError> {
        let limits = [
            ("width", u64::from(self.width), 8, 8_192),
            ("height", u64::from(self.height), 8, 8_192),
            ("views", self.views as u64, 2, 1_000),
            ("samples", u64::from(self.samples), 1, 16),
            ("points", self.points as u64, 1, 10_000_000),
        ];
        for (field, value, least, most) in limits {
            if !(least..=most).contains(&value) {
                return Err(DemoError::Option { field, value, least, most });
            }
        }
        Ok(())
    }
}

/// Why the demo scene cannot be made. A problem with the cache is not an error; it is reported in `Dataset::notes`.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// A field of [`DemoOptions`] is out of range.
    #[error("demo scene: option `{field}` is {value}; choose a number from {least} to {most}")]
    Option {
        /// Name of the field.
        field: &'static str,
        /// What it holds.
        value: u64,
        /// Smallest allowed value.
        least: u64,
        /// Largest allowed value.
        most: u64,
    },
    /// The demo scene exists in two sizes.
    #[error("the model's demo scene is {width} pixels wide, which is no size of it")]
    Size {
        /// Width of its photos.
        width: u32,
    },
    /// The folder holds something else.
    #[error("{} holds another scene; name a new folder", path.display())]
    OtherScene {
        /// The folder.
        path: PathBuf,
    },
    /// A photo cannot be decoded again.
    #[error(transparent)]
    Photo(#[from] DatasetError),
}

/// Reads the demo scene from the cache and traces what is missing or damaged there.
///
/// The scene gets its own folder in `cache_dir` (`None`: `ibgs` in the user's cache folder), named after the options
/// and [`VERSION`]. A cache that cannot be written only costs time and adds a note. `progress` receives the photos
/// that are traced.
pub fn load(options: &DemoOptions, cache_dir: Option<&Path>, progress: &dyn Progress) -> Result<Dataset, DemoError> {
    options.validate()?;
    let traced = Traced {
        scene: scene::scene(),
        cache: Cache::new(cache_dir, &options.folder_name()),
        cameras: cameras(options),
        samples: options.samples,
        points: (options.points, options.seed),
    };
    Ok(Dataset { glossy: Some(glossy), ..traced.load(options, progress) })
}

/// The demo scene that a run is trained on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunOptions {
    /// Width of the photos in pixels, which tells the two sizes of the scene.
    pub width: u32,
    /// With a seed every photo has another exposure.
    pub exposure_seed: Option<u64>,
    /// Percent of the training photos that show a walker.
    pub walkers: u32,
}

/// The demo scene as a run was trained on it, in one of its two sizes.
///
/// # Errors
/// It has no photos of this width, or the walkers are out of range.
pub fn of_run(options: &RunOptions, progress: &dyn Progress) -> Result<Dataset, DemoError> {
    let RunOptions { width, exposure_seed, walkers: percent } = *options;
    let presets = [DemoOptions::small(), DemoOptions::large()];
    let scene = presets.into_iter().find(|preset| preset.width == width).ok_or(DemoError::Size { width })?;
    let Walked { mut dataset, .. } = walkers(&WalkerOptions { scene, percent }, None, progress)?;
    if let Some(seed) = exposure_seed {
        change_exposure(&mut dataset, seed)?;
    }
    Ok(dataset)
}

/// Whether each pixel of a view shows a glossy or mirror-like object.
fn glossy(camera: &Camera) -> Vec<bool> {
    truth(camera).object.into_iter().map(is_view_dependent).collect()
}

/// A scene to trace: what it is made of.
struct Traced<'a> {
    scene: &'a scene::Scene,
    cache: Cache,
    cameras: Vec<Camera>,
    /// Rays a pixel along each side.
    samples: u32,
    /// Number of points, and their seed.
    points: (usize, u64),
}

/// Distance in metres from a point inside the room to the nearest true surface (lamps included).
pub fn distance_to_surface(point: DVec3) -> f64 {
    scene::scene().distance(point)
}

/// File name of a photo among `count`: in the order of the names.
fn view_name(index: usize, count: usize) -> String {
    let digits = count.saturating_sub(1).to_string().len().max(3);
    format!("view_{index:0digits$}.png")
}

impl Traced<'_> {
    /// Reads what the cache has, traces the rest, and writes it there with the `options` that it was made with.
    fn load(&self, options: &impl Serialize, progress: &dyn Progress) -> Dataset {
        let mut notes = Vec::new();
        let wanted: Vec<(String, Camera)> =
            (0..self.cameras.len()).map(|index| (view_name(index, self.cameras.len()), self.cameras[index])).collect();
        let render = |index: usize| trace::render_in(self.scene, &self.cameras[index], self.samples);
        let (photos, trouble) = self.cache.photos(&wanted, render, progress, &mut notes);
        let view = |((name, camera), photo): (_, Photo)| View { name, camera, photo: photo.into() };
        let views: Vec<View> = wanted.into_iter().zip(photos).map(view).collect();
        let (test, train): (Vec<usize>, Vec<usize>) = (0..views.len()).partition(|index| index % TEST_EVERY == 0);
        let found = cloud::points(self.scene, self.points, &views, &train);
        let tracks = tracks::tracks(self.scene, &self.cameras, &found, self.points.1);
        let points: Vec<Point> = found.into_iter().map(|found| found.point).collect();
        notes.extend(trouble.or_else(|| self.cache.describe(options, &self.cameras, (&points, &tracks)).err()));
        Dataset {
            path: self.cache.path(),
            views,
            train,
            test,
            points,
            points_from: PointsFrom::Scene,
            extent: None,
            masks: Masks::Ignore,
            backdrop: None,
            glossy: None,
            made_tracks: tracks.into(),
            loaded_checksum: None,
            notes,
        }
    }
}
