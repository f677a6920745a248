//! The demo scene on disk: a nerfstudio scene folder (`transforms.json`, `images/`, `points3D.ply`), with what the photos have of the
//! points in `colmap/sparse/0/` and masks of walkers in `walkers/`.
//!
//! Only the photos are read back: poses and points follow from the options. Each file is written to a temporary name
//! and renamed, so an interrupted run leaves whole files, which the next run keeps.

use super::{VERSION, view_name};
use glam::DVec3;
use ibgs_data::adjust::{Seen, Track};
use ibgs_data::camera::Camera;
use ibgs_data::dataset::{Photo, Point, colmap_text};
use ibgs_data::files::write_atomically;
use ibgs_data::progress::Progress;
use image::{ExtendedColorType, ImageEncoder, ImageFormat};
use rayon::prelude::*;
use serde::Serialize;
use std::io::Error;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The file that lists the photos.
const LISTING: &str = "transforms.json";

/// The COLMAP model beside it, as nerfstudio has it.
const MODEL: &str = "colmap/sparse/0";

/// What the cache holds for one photo.
enum Found {
    /// The photo.
    Photo(Photo),
    /// Nothing readable.
    Missing,
    /// A file that is no photo of the right size.
    Damaged,
}

/// The folder of one set of options, if the machine has a cache folder at all.
pub(super) struct Cache {
    folder: Option<PathBuf>,
}

impl Cache {
    /// The folder of this name in `dir`; none: in `ibgs` of the user's cache folder. Touches nothing yet.
    pub fn new(dir: Option<&Path>, name: &str) -> Self {
        let base = dir.map_or_else(|| Some(dirs::cache_dir()?.join("ibgs")), |dir| Some(dir.to_owned()));
        Cache { folder: base.map(|base| base.join(name)) }
    }

    /// A folder that is named.
    pub fn at(folder: &Path) -> Self {
        Cache { folder: Some(folder.to_owned()) }
    }

    /// The scene folder; without one a name in its place.
    pub fn path(&self) -> PathBuf {
        self.folder.clone().unwrap_or_else(|| PathBuf::from("demo"))
    }

    /// Whether the folder is new, or lists a scene of these options and this version.
    pub fn is_for(&self, options: &impl Serialize) -> bool {
        let Some(folder) = &self.folder else { return true };
        let Ok(text) = std::fs::read(folder.join(LISTING)) else { return !folder.join("images").exists() };
        let listed: Option<serde_json::Value> = serde_json::from_slice(&text).ok();
        let own = serde_json::to_value(Origin { version: VERSION, options }).ok();
        own.is_some() && own.as_ref() == listed.as_ref().and_then(|listed| listed.get("ibgs_demo"))
    }

    /// The photos of these names: those that are there, and the others made, by their place in the list. Also a note if those
    /// could not be written.
    pub fn photos(
        &self,
        wanted: &[(String, Camera)],
        make: impl Fn(usize) -> Photo + Sync,
        progress: &dyn Progress,
        notes: &mut Vec<String>,
    ) -> (Vec<Photo>, Option<String>) {
        let read = |(name, camera): &(String, Camera)| self.read_photo(name, camera.width, camera.height);
        let found: Vec<Found> = wanted.par_iter().map(read).collect();
        let damaged = found.iter().filter(|found| matches!(found, Found::Damaged)).count();
        if damaged > 0 {
            notes.push(format!("{damaged} cached photo(s) of the demo scene were damaged and traced again"));
        }
        let missing = found.iter().filter(|found| !matches!(found, Found::Photo(_))).count();
        if missing > 0 {
            progress.begin("ray tracing the demo scene", missing);
        }
        let trouble: Mutex<Option<String>> = Mutex::new(None);
        let note = || trouble.lock().unwrap_or_else(PoisonError::into_inner);
        let photos = found
            .into_par_iter()
            .enumerate()
            .map(|(index, found)| {
                if let Found::Photo(photo) = found {
                    return photo;
                }
                let photo = make(index);
                let given_up = note().is_some();
                if !given_up && let Err(message) = self.write_photo(&wanted[index].0, &photo) {
                    note().get_or_insert(message);
                }
                progress.step();
                photo
            })
            .collect();
        progress.end();
        let trouble = note().take();
        (photos, trouble)
    }

    /// Reads one photo.
    fn read_photo(&self, name: &str, width: u32, height: u32) -> Found {
        let Some(folder) = &self.folder else {
            return Found::Missing;
        };
        let Ok(bytes) = std::fs::read(folder.join("images").join(name)) else {
            return Found::Missing;
        };
        match image::load_from_memory_with_format(&bytes, ImageFormat::Png) {
            Ok(image::DynamicImage::ImageRgb8(rgb)) if rgb.dimensions() == (width, height) => {
                let rgba = image::DynamicImage::ImageRgb8(rgb).into_rgba8().into_raw();
                Found::Photo(Photo { width, height, rgba })
            }
            _ => Found::Damaged,
        }
    }

    /// Writes one photo unless there is a file of its name; the error is a note for the user.
    pub fn keep_photo(&self, name: &str, photo: &Photo) -> Result<(), String> {
        let is_there = self.folder.as_ref().is_some_and(|folder| folder.join("images").join(name).is_file());
        if is_there { Ok(()) } else { self.write_photo(name, photo) }
    }

    /// Writes one photo; the error is a note for the user.
    fn write_photo(&self, name: &str, photo: &Photo) -> Result<(), String> {
        let rgb: Vec<u8> = photo.rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        self.write_png(Path::new("images").join(name), &rgb, [photo.width, photo.height], ExtendedColorType::Rgb8)
    }

    /// Writes the mask of a photo's walker; the error is a note for the user.
    pub fn write_mask(&self, name: &str, levels: &[u8], size: [u32; 2]) -> Result<(), String> {
        self.write_png(Path::new("walkers").join(name), levels, size, ExtendedColorType::L8)
    }

    fn write_png(&self, name: PathBuf, bytes: &[u8], size: [u32; 2], kind: ExtendedColorType) -> Result<(), String> {
        let mut png = Vec::new();
        image::codecs::png::PngEncoder::new(&mut png)
            .write_image(bytes, size[0], size[1], kind)
            .map_err(|error| self.note(&Error::other(error)))?;
        self.write(name, &png)
    }

    /// Writes `transforms.json`, `points3D.ply` and the COLMAP model of the tracks unless they are there already; the error is a note.
    pub fn describe(
        &self,
        options: &impl Serialize,
        cameras: &[Camera],
        (points, tracks): (&[Point], &[Track]),
    ) -> Result<(), String> {
        self.write(PathBuf::from("points3D.ply"), &ply(points))?;
        let names: Vec<String> = (0..cameras.len()).map(|index| view_name(index, cameras.len())).collect();
        let photos = names.iter().map(String::as_str).zip(cameras);
        for (name, text) in colmap_text(photos, &tracked(points, tracks)) {
            self.write(Path::new(MODEL).join(name), text.as_bytes())?;
        }
        self.list(options, cameras)
    }

    /// Writes `transforms.json` unless it is there already; the error is a note.
    pub fn list(&self, options: &impl Serialize, cameras: &[Camera]) -> Result<(), String> {
        let transforms = serde_json::to_vec_pretty(&Transforms::new(options, cameras))
            .map_err(|error| self.note(&Error::other(error)))?;
        self.write(PathBuf::from(LISTING), &transforms)
    }

    fn write(&self, name: PathBuf, bytes: &[u8]) -> Result<(), String> {
        let Some(folder) = &self.folder else {
            return Err("this machine has no cache folder, so the demo scene is traced again each \
                time; name a folder to keep it in"
                .into());
        };
        let path = folder.join(name);
        if std::fs::read(&path).is_ok_and(|old| old == bytes) {
            return Ok(());
        }
        write_atomically(&path, |out| out.write_all(bytes)).map_err(|error| self.note(&error.source))
    }

    fn note(&self, error: &Error) -> String {
        let folder = self.folder.as_deref().unwrap_or(Path::new("(none)")).display();
        format!(
            "the demo scene could not be cached in {folder} ({error}), so it will be traced again \
             next time; make that folder writable or name another one"
        )
    }
}

/// nerfstudio's `transforms.json`: one pinhole for all frames, OpenGL axes (x right, y up, z backwards).
#[derive(Serialize)]
struct Transforms<'a, T> {
    camera_model: &'static str,
    w: u32,
    h: u32,
    fl_x: f64,
    fl_y: f64,
    cx: f64,
    cy: f64,
    k1: f64,
    k2: f64,
    p1: f64,
    p2: f64,
    ply_file_path: &'static str,
    frames: Vec<CachedView>,
    ibgs_demo: Origin<'a, T>,
}

#[derive(Serialize)]
struct CachedView {
    file_path: String,
    transform_matrix: [[f64; 4]; 4],
}

#[derive(Serialize)]
struct Origin<'a, T> {
    version: u32,
    options: &'a T,
}

impl<'a, T> Transforms<'a, T> {
    fn new(options: &'a T, cameras: &[Camera]) -> Self {
        let first = cameras[0];
        let frame = |(index, camera): (usize, &Camera)| CachedView {
            file_path: format!("images/{}", view_name(index, cameras.len())),
            transform_matrix: opengl_pose(camera),
        };
        Transforms {
            camera_model: "OPENCV",
            w: first.width,
            h: first.height,
            fl_x: first.focal.x,
            fl_y: first.focal.y,
            cx: first.principal.x,
            cy: first.principal.y,
            k1: 0.0,
            k2: 0.0,
            p1: 0.0,
            p2: 0.0,
            ply_file_path: "points3D.ply",
            frames: cameras.iter().enumerate().map(frame).collect(),
            ibgs_demo: Origin { version: VERSION, options },
        }
    }
}

/// `world_from_camera` with OpenGL's camera axes, row by row.
fn opengl_pose(camera: &Camera) -> [[f64; 4]; 4] {
    let world_from_view = camera.view_from_world.transpose();
    let columns = [world_from_view.x_axis, -world_from_view.y_axis, -world_from_view.z_axis, camera.center()];
    let row = |pick: fn(DVec3) -> f64| columns.map(pick);
    [row(|c| c.x), row(|c| c.y), row(|c| c.z), [0.0, 0.0, 0.0, 1.0]]
}

/// The points that have tracks, in the order of both, with their places as [`ply`] has them.
fn tracked(points: &[Point], tracks: &[Track]) -> Vec<(Point, Vec<Seen>)> {
    let mut points = points.iter();
    let place = |track: &Track| {
        let point = points.find(|point| Some(point.position) == track.position)?;
        Some((Point { position: point.position.as_vec3().as_dvec3(), ..*point }, track.seen.clone()))
    };
    tracks.iter().filter_map(place).collect()
}

/// Points as a binary PLY: `x y z` float32 in metres, `red green blue` uint8.
fn ply(points: &[Point]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        points.len()
    )
    .into_bytes();
    for point in points {
        for coordinate in point.position.as_vec3().to_array() {
            bytes.extend_from_slice(&coordinate.to_le_bytes());
        }
        bytes.extend_from_slice(&point.color);
    }
    bytes
}
