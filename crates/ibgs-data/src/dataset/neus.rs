//! The layout of NeuS and IDR: `cameras_sphere.npz` (or `cameras.npz`), photos in `image/`, masks in `mask/`.
//!
//! The archive has an array `world_mat_0`, `world_mat_1` ... for each photo, in the order of the photos' names: the projection
//! from the world to pixels, P = K [R | t], of which K, R and t are the decomposition. `scale_mat_0` ... , which move the object
//! into the unit sphere, are not used: the scene keeps the units of its world. Masks are in the order of the photos too.

use super::decode::photo_size;
use super::error::{DatasetError, read_bytes};
use super::format::not_a_scene;
use super::lens::{Distortion, Lens, Pose};
use super::masks::MaskFinder;
use super::names::{PhotoFolders, RelativeTo, inside, photos_in};
use super::photos::ListedPhoto;
use super::{LoadOptions, Loader, Scene, SceneFile, SceneKind, npy};
use glam::{DMat3, DVec2, DVec3};
use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// Archives of cameras, the usual one first.
const FILES: [&str; 3] = ["cameras_sphere.npz", "cameras.npz", "cameras_large.npz"];
/// Folders of photos and of masks.
const PHOTOS: [&str; 2] = ["image", "images"];
const MASKS: &str = "mask";
/// Points that preparation from COLMAP leaves beside the cameras.
const POINTS: [&str; 2] = ["sparse_points.ply", "sparse_points_interest.ply"];
const MATRIX: &str = "world_mat_";
/// Bytes of a matrix with its header; anything larger is none.
const MOST_BYTES: u64 = 1 << 16;
/// Pixels by which a skewed axis may shift the upper or lower edge of a photo.
const MOST_SKEW: f64 = 0.5;
/// Largest error of the axes of a rotation.
const ROUNDING: f64 = 1e-6;
/// Pixels by which two photos of one camera may differ, from rounding.
const SAME: f64 = 0.01;

/// The file of a folder, or the file itself.
fn listing(scene: &Path) -> Option<PathBuf> {
    if scene.is_file() {
        let is_archive = scene.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npz"));
        return is_archive.then(|| scene.to_owned());
    }
    FILES.iter().map(|name| scene.join(name)).find(|path| path.is_file())
}

/// A projection taken apart.
#[derive(Debug)]
struct Camera {
    focal: DVec2,
    principal: DVec2,
    skew: f64,
    pose: Pose,
}

impl Camera {
    /// P = K [R | t] up to a factor: K has zeros below its diagonal, on which it is positive, and R is a rotation. The rows of
    /// R follow from the last one on, each at right angles to those below it.
    fn decompose([a, b, c]: [DVec3; 3], p: DVec3) -> Result<Camera, String> {
        let volume = a.dot(b.cross(c));
        // Of the factor only the sign matters to the rotation.
        let sign = volume.signum();
        let ([a, b, c], p) = ([a, b, c].map(|row| row * sign), p * sign);
        let scale = c.length();
        let z = c / scale;
        let (cy, cx) = (b.dot(z), a.dot(z));
        let fy = (b - cy * z).length();
        let y = (b - cy * z) / fy;
        let skew = a.dot(y);
        let fx = (a - cx * z - skew * y).length();
        let x = (a - cx * z - skew * y) / fx;
        let k = DMat3::from_cols(DVec3::new(fx, 0.0, 0.0), DVec3::new(skew, fy, 0.0), DVec3::new(cx, cy, scale));
        let rotation = DMat3::from_cols(x, y, z).transpose();
        let is_turn = (rotation * rotation.transpose()).abs_diff_eq(DMat3::IDENTITY, ROUNDING);
        if !(is_turn && volume.abs() > 0.0 && k.is_finite() && k.determinant() > 0.0) {
            return Err("its left 3 x 3 part is no camera with a rotation: it has no inverse".to_owned());
        }
        let pose = Pose::from_view(rotation, k.inverse() * p)?;
        Ok(Camera {
            focal: DVec2::new(fx, fy) / scale,
            principal: DVec2::new(cx, cy) / scale,
            skew: skew / scale,
            pose,
        })
    }

    /// Of a matrix of 3 x 4 or 4 x 4.
    fn of(matrix: &npy::Array) -> Result<Camera, String> {
        if !matches!(matrix.shape[..], [3 | 4, 4]) {
            return Err(format!("it has the shape {:?} where a matrix of 4 x 4 is needed", matrix.shape));
        }
        let rows = &matrix.values[..12];
        if rows.iter().any(|v| !v.is_finite()) {
            return Err("it holds a number that is not finite".to_owned());
        }
        let row = |r: usize| DVec3::new(rows[4 * r], rows[4 * r + 1], rows[4 * r + 2]);
        Camera::decompose([row(0), row(1), row(2)], DVec3::new(rows[3], rows[7], rows[11]))
    }

    /// The lens, for a photo of this size.
    fn lens(&self, (width, height): (u32, u32)) -> Result<Lens, String> {
        let Camera { focal, principal, skew, .. } = *self;
        let size = DVec2::new(f64::from(width), f64::from(height));
        if skew.abs() * size.y / 2.0 > MOST_SKEW * focal.y {
            return Err(format!(
                "its axes are skewed by {skew:.3} pixels, which is not supported; undistort the photos"
            ));
        }
        if principal.cmplt(DVec2::ZERO).any() || principal.cmpgt(size).any() {
            let DVec2 { x, y } = principal;
            return Err(format!(
                "the principal point ({x:.1}, {y:.1}) lies outside of the photo of {width} x {height} pixels: the cameras \
                 belong to photos of another size"
            ));
        }
        let lens = Lens { width, height, focal, principal, distortion: Distortion::default() };
        lens.problem().map_or(Ok(lens), Err)
    }
}

fn bad(path: &Path, place: impl Into<String>, problem: String) -> DatasetError {
    DatasetError::Format { path: path.to_owned(), place: place.into(), problem }
}

/// The cameras in the contents of an archive, in their order.
fn cameras(path: &Path, bytes: &[u8]) -> Result<Vec<Camera>, DatasetError> {
    let broken = |error: &dyn std::fmt::Display| bad(path, "archive", format!("it is no whole NPZ archive ({error})"));
    let mut zip = ZipArchive::new(Cursor::new(bytes)).map_err(|error| broken(&error))?;
    let mut cameras = BTreeMap::new();
    for entry in 0..zip.len() {
        let entry = zip.by_index(entry).map_err(|error| broken(&error))?;
        // A name that is no text is none of a matrix.
        let name = entry.name().map(|name| name.trim_end_matches(".npy").to_owned()).unwrap_or_default();
        let Some(number) = name.strip_prefix(MATRIX).and_then(|number| number.parse::<usize>().ok()) else { continue };
        let mut array = Vec::new();
        entry.take(MOST_BYTES).read_to_end(&mut array).map_err(|error| broken(&error))?;
        let camera = npy::parse(&array).and_then(|matrix| Camera::of(&matrix));
        cameras.insert(number, camera.map_err(|problem| bad(path, format!("`{name}`"), problem))?);
    }
    let missing = cameras.keys().zip(0..).find_map(|(&number, expected)| (number != expected).then_some(expected));
    if let (Some(missing), Some(last)) = (missing, cameras.keys().last()) {
        let problem = format!("`{MATRIX}{missing}` is missing, but there is `{MATRIX}{last}`");
        return Err(bad(path, "archive", problem));
    }
    if cameras.is_empty() {
        return Err(bad(path, "archive", format!("it has no matrix `{MATRIX}0`")));
    }
    Ok(cameras.into_values().collect())
}

/// The folder of the photos: the one that the user names, or the usual one.
fn photo_folder(root: &Path, options: &LoadOptions) -> Result<PathBuf, DatasetError> {
    let folders = PhotoFolders::new(root, RelativeTo::Photos, options);
    if let Some(path) = folders.absent() {
        return Err(DatasetError::NoPhotoFolder { path });
    }
    if options.images.is_some() {
        return Ok(folders.main());
    }
    let usual = PHOTOS.iter().map(|name| root.join(name)).find(|folder| folder.is_dir());
    usual.ok_or_else(|| DatasetError::NoPhotoFolder { path: root.join(PHOTOS[0]) })
}

/// The masks of photos: where there is one for each, in their order, else by name.
fn masks(root: &Path, photos: &[PathBuf]) -> Vec<Option<PathBuf>> {
    let all = photos_in(&root.join(MASKS));
    if all.len() == photos.len() {
        return all.into_iter().map(Some).collect();
    }
    let finder = MaskFinder::new(root);
    let of = |photo: &PathBuf| {
        let own = all.iter().find(|mask| mask.file_stem() == photo.file_stem()).cloned();
        own.or_else(|| finder.find(&photo.file_name()?.to_string_lossy(), photo))
    };
    photos.iter().map(of).collect()
}

/// Such an archive, or a folder with one.
#[derive(Debug)]
pub(crate) struct Neus;

impl Loader for Neus {
    fn shown_by(&self) -> &str {
        "cameras_sphere.npz (NeuS)"
    }

    fn is_scene(&self, path: &Path) -> bool {
        listing(path).is_some()
    }

    fn files(&self) -> &'static [SceneFile] {
        &[SceneFile { name: FILES[0], check: |path, bytes| Ok(cameras(path, bytes)?.len()) }]
    }

    /// Reads the cameras and finds the photos.
    fn read(&self, scene: &Path, options: &LoadOptions) -> Result<Scene, DatasetError> {
        let listing = listing(scene).ok_or_else(|| not_a_scene(scene))?;
        let root = super::root(&listing).to_owned();
        let folder = photo_folder(&root, options)?;
        let cameras = cameras(&listing, &read_bytes(&listing)?)?;
        let photos = photos_in(&folder);
        if photos.len() != cameras.len() {
            let (poses, photos) = (cameras.len(), photos.len());
            return Err(DatasetError::PoseCount { path: listing, folder, poses, photos });
        }
        let masks = masks(&root, &photos);
        let mut frames: Vec<ListedPhoto> = Vec::with_capacity(photos.len());
        for (index, ((photo, mask), camera)) in photos.into_iter().zip(masks).zip(cameras).enumerate() {
            let name = photo.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if inside(&name, |_| true).is_none() {
                return Err(DatasetError::ImageName { path: listing, name });
            }
            let own = camera.lens(photo_size(&photo)?).map_err(|problem| DatasetError::Intrinsics {
                path: listing.clone(),
                camera: format!("`{MATRIX}{index}` ({name})"),
                problem,
            })?;
            // Rounding in the matrices makes one camera many.
            let lens = frames.last().map(|frame| frame.lens).filter(|lens| is_same(lens, &own)).unwrap_or(own);
            frames.push(ListedPhoto { name, photo, mask, lens, pose: camera.pose, prescaled: false, key: None });
        }
        let point_files = POINTS.iter().map(|name| root.join(name)).collect();
        Ok(Scene { point_files, ..Scene::new(SceneKind::new("neus", "NeuS"), listing, frames) })
    }
}

fn is_same(a: &Lens, b: &Lens) -> bool {
    let is_near = |a: DVec2, b: DVec2| a.abs_diff_eq(b, SAME);
    [a.width, a.height] == [b.width, b.height] && is_near(a.focal, b.focal) && is_near(a.principal, b.principal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// Any projection comes apart into the parts that it was made of, whatever its factor.
    #[test]
    fn projections_come_apart() {
        for (i, factor) in [1.0, -1.0, 300.0, -2e-4].into_iter().enumerate() {
            let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.7 + i as f64, -0.4, 2.0));
            let t = DVec3::new(-30.0, 12.5, 640.0);
            let (focal, principal, skew) = (DVec2::new(2892.3, 2883.2), DVec2::new(823.2, 619.1), 0.25);
            let k = DMat3::from_cols(
                DVec3::new(focal.x, 0.0, 0.0),
                DVec3::new(skew, focal.y, 0.0),
                DVec3::new(principal.x, principal.y, 1.0),
            );
            let (m, p) = (k * turn * factor, k * t * factor);
            let found = Camera::decompose([m.row(0), m.row(1), m.row(2)], p).unwrap();
            assert!(found.focal.abs_diff_eq(focal, 1e-8) && found.principal.abs_diff_eq(principal, 1e-8), "{found:?}");
            assert!(
                (found.skew - skew).abs() < 1e-8 && found.pose.view_from_world.abs_diff_eq(turn, 1e-12),
                "{found:?}"
            );
            assert!(found.pose.translation.abs_diff_eq(t, 1e-8), "{found:?}");
        }
        for rows in [[DVec3::ZERO; 3], [DVec3::X, DVec3::X, DVec3::Z], [DVec3::X, DVec3::Y, DVec3::ZERO]] {
            assert!(Camera::decompose(rows, DVec3::ONE).unwrap_err().contains("no inverse"));
        }
    }
}
