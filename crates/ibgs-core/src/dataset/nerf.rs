//! `transforms.json` of instant-ngp and nerfstudio, and Blender's `transforms_train.json` / `transforms_test.json`.
//!
//! Poses are camera-to-world with OpenGL axes; focal lengths come from `fl_x` or `camera_angle_x`; any intrinsic
//! may stand in the file or in a frame, the frame wins. Distortion follows nerfstudio: `k1 .. k4` are the factors
//! of `r^2 .. r^8`, and with `OPENCV_FISHEYE` (or instant-ngp's `is_fisheye`) of the angle's even powers.

use super::colmap::{reduced_folder, reduced_note};
use super::decode::photo_size;
use super::error::{DatasetError, read_bytes};
use super::lens::{Distortion, Lens, Pose, Projection};
use super::photos::{ListedPhoto, clean_name, find_mask, find_photo, image_name};
use super::{CameraInfo, LoadOptions, Scene, SceneInfo, SceneKind, points};
use glam::DVec2;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Intrinsics as the file states them, in pixels and radians.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
struct Intrinsics {
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

#[derive(Deserialize)]
struct FrameJson {
    file_path: String,
    transform_matrix: Vec<Vec<f64>>,
    mask_path: Option<String>,
    #[serde(flatten)]
    intrinsics: Intrinsics,
}

#[derive(Deserialize)]
struct FileJson {
    frames: Vec<FrameJson>,
    ply_file_path: Option<String>,
    #[serde(flatten)]
    intrinsics: Intrinsics,
}

/// Camera models whose distortion is the polynomial of [`Distortion`].
const MODELS: [&str; 7] = ["PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "PERSPECTIVE", FISHEYE];
const FISHEYE: &str = "OPENCV_FISHEYE";

impl Intrinsics {
    /// This frame's values, the file's where the frame is silent. A focal length in the frame hides the file's
    /// in every form.
    fn or(&self, file: &Intrinsics) -> Intrinsics {
        let own_x = self.fl_x.is_some() || self.camera_angle_x.is_some();
        let own_y = own_x || self.fl_y.is_some() || self.camera_angle_y.is_some();
        Intrinsics {
            camera_model: self.camera_model.clone().or_else(|| file.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(file.is_fisheye),
            w: self.w.or(file.w),
            h: self.h.or(file.h),
            fl_x: self.fl_x.or(file.fl_x.filter(|_| !own_x)),
            fl_y: self.fl_y.or(file.fl_y.filter(|_| !own_y)),
            cx: self.cx.or(file.cx),
            cy: self.cy.or(file.cy),
            camera_angle_x: self.camera_angle_x.or(file.camera_angle_x.filter(|_| !own_x)),
            camera_angle_y: self.camera_angle_y.or(file.camera_angle_y.filter(|_| !own_y)),
            k1: self.k1.or(file.k1),
            k2: self.k2.or(file.k2),
            k3: self.k3.or(file.k3),
            k4: self.k4.or(file.k4),
            p1: self.p1.or(file.p1),
            p2: self.p2.or(file.p2),
        }
    }

    /// The model's name where it cannot be undistorted here.
    fn unsupported_model(&self) -> Option<String> {
        self.camera_model.clone().filter(|model| !MODELS.contains(&model.as_str()))
    }

    /// Image size as stated, else as the photo's header has it.
    fn size(&self, photo: &Path) -> Result<Result<(u32, u32), String>, DatasetError> {
        let (Some(w), Some(h)) = (self.w, self.h) else {
            return photo_size(photo).map(Ok);
        };
        let whole = |side: f64| (1.0..=f64::from(u32::MAX)).contains(&side);
        if whole(w) && whole(h) {
            return Ok(Ok((w.round() as u32, h.round() as u32)));
        }
        Ok(Err(format!("the image size w = {w}, h = {h} is not a number of pixels")))
    }

    /// The lens, or what is wrong with the numbers.
    fn lens(&self, (width, height): (u32, u32)) -> Result<Lens, String> {
        let size = DVec2::new(f64::from(width), f64::from(height));
        let from_angle = |side: f64, angle: f64| 0.5 * side / (0.5 * angle).tan();
        let fl_x = self.fl_x.or(self.camera_angle_x.map(|angle| from_angle(size.x, angle)));
        let fl_y = self.fl_y.or(self.camera_angle_y.map(|angle| from_angle(size.y, angle)));
        let Some(fx) = fl_x.or(fl_y) else {
            return Err("there is no focal length: fl_x or camera_angle_x is missing".to_owned());
        };
        let fisheye = self.is_fisheye == Some(true) || self.camera_model.as_deref() == Some(FISHEYE);
        let lens = Lens {
            width,
            height,
            focal: DVec2::new(fx, fl_y.unwrap_or(fx)),
            principal: DVec2::new(self.cx.unwrap_or(size.x / 2.0), self.cy.unwrap_or(size.y / 2.0)),
            distortion: Distortion {
                projection: if fisheye { Projection::Equidistant } else { Projection::Perspective },
                radial: [self.k1, self.k2, self.k3, self.k4].map(Option::unwrap_or_default),
                rational: [0.0; 3],
                tangential: [self.p1, self.p2].map(Option::unwrap_or_default),
                prism: [0.0; 2],
            },
        };
        lens.problem().map_or(Ok(lens), Err)
    }
}

/// The files of a scene: the second one is held out.
fn listings(scene: &Path) -> Option<(SceneKind, Vec<PathBuf>)> {
    if scene.is_file() && scene.extension().is_some_and(|extension| extension == "json") {
        return Some((SceneKind::Transforms, vec![scene.to_owned()]));
    }
    let existing = |name: &str| Some(scene.join(name)).filter(|path| path.is_file());
    if let Some(path) = existing("transforms.json") {
        return Some((SceneKind::Transforms, vec![path]));
    }
    let train = existing("transforms_train.json")?;
    let files = std::iter::once(train).chain(existing("transforms_test.json")).collect();
    Some((SceneKind::Blender, files))
}

/// Whether the path is a `transforms.json` or a folder with one.
pub(crate) fn is_scene(scene: &Path) -> bool {
    listings(scene).is_some()
}

/// Where photos come from: the named folder, a reduced one, or as the file says.
struct Folders<'a> {
    root: PathBuf,
    named: Option<&'a str>,
    reduced: Option<String>,
}

impl Folders<'_> {
    /// The photo of an image name, or where it was looked for; and whether it is a reduced one.
    fn find(&self, name: &str) -> (Result<PathBuf, PathBuf>, bool) {
        let (first, rest) = name.split_once('/').unwrap_or(("", name));
        let (relative, prescaled) = match (self.named, &self.reduced) {
            (Some(folder), _) => (format!("{folder}/{rest}"), false),
            (None, Some(folder)) if first == "images" => (format!("{folder}/{rest}"), true),
            _ => (name.to_owned(), false),
        };
        let found = find_photo(&self.root, &relative).ok_or_else(|| self.root.join(relative));
        (found, prescaled)
    }
}

/// Reads the listing and finds its photos.
pub(crate) fn read(scene: &Path, options: &LoadOptions) -> Result<Scene, DatasetError> {
    let not_a_scene = || DatasetError::NotAScene { path: scene.to_owned() };
    let (kind, files) = listings(scene).ok_or_else(not_a_scene)?;
    let listing = files.first().ok_or_else(not_a_scene)?.clone();
    let root = listing.parent().unwrap_or(Path::new("")).to_owned();
    let named = options.images.as_deref();
    if let Some(path) = named.map(|folder| root.join(folder)).filter(|path| !path.is_dir()) {
        return Err(DatasetError::NoPhotoFolder { path });
    }
    let reduced = reduced_folder(&root, options).filter(|_| named.is_none());
    let folders = Folders { root: root.clone(), named, reduced };
    let mut scene = Scene {
        kind,
        listing,
        frames: Vec::new(),
        missing: Vec::new(),
        points: Vec::new(),
        point_files: Vec::new(),
        held_out: (kind == SceneKind::Blender).then(Vec::new),
        notes: Vec::new(),
    };
    for (index, path) in files.iter().enumerate() {
        let before = scene.frames.len();
        read_file(path, &folders, &mut scene)?;
        if let (1.., Some(held_out)) = (index, &mut scene.held_out) {
            held_out.extend(scene.frames[before..].iter().map(|frame| frame.name.clone()));
        }
    }
    if let Some(folder) = folders.reduced.filter(|_| scene.frames.iter().any(|frame| frame.prescaled)) {
        scene.notes.push(reduced_note(&folder));
    }
    Ok(scene)
}

/// Adds the frames and the cloud of one file.
fn read_file(path: &Path, folders: &Folders, scene: &mut Scene) -> Result<(), DatasetError> {
    let file: FileJson = serde_json::from_slice(&read_bytes(path)?)
        .map_err(|cause| DatasetError::Json { path: path.to_owned(), cause: cause.to_string() })?;
    for (index, frame) in file.frames.iter().enumerate() {
        read_frame(path, index, frame, &file.intrinsics, folders, scene)?;
    }
    if let Some(ply) = &file.ply_file_path {
        let name = clean_name(ply).ok_or_else(|| {
            let problem = format!("`{ply}` is absolute or leaves the scene folder");
            DatasetError::field(path, "ply_file_path", problem)
        })?;
        let ply = folders.root.join(name);
        if ply.is_file() {
            scene.point_files.push(ply);
        } else {
            scene.notes.push(format!("ply_file_path {} does not exist", ply.display()));
        }
    }
    Ok(())
}

fn read_frame(
    path: &Path,
    index: usize,
    frame: &FrameJson,
    shared: &Intrinsics,
    folders: &Folders,
    scene: &mut Scene,
) -> Result<(), DatasetError> {
    let given = &frame.file_path;
    let name =
        image_name(given).ok_or_else(|| DatasetError::ImageName { path: path.to_owned(), name: given.clone() })?;
    let intrinsics = frame.intrinsics.or(shared);
    let camera = format!("frames[{index}] (`{name}`)");
    if let Some(model) = intrinsics.unsupported_model() {
        return Err(DatasetError::CameraModel { path: path.to_owned(), camera, model });
    }
    let pose = Pose::from_opengl(&frame.transform_matrix)
        .map_err(|problem| DatasetError::field(path, format!("frames[{index}].transform_matrix"), problem))?;
    let (photo, prescaled) = match folders.find(&name) {
        (Ok(photo), prescaled) => (photo, prescaled),
        (Err(missing), _) => {
            scene.missing.push(missing);
            return Ok(());
        }
    };
    let lens = intrinsics
        .size(&photo)?
        .and_then(|size| intrinsics.lens(size))
        .map_err(|problem| DatasetError::Intrinsics { path: path.to_owned(), camera, problem })?;
    let mask = mask(&folders.root, frame, &name, path, index)?;
    let name = with_extension(name, &photo);
    scene.frames.push(ListedPhoto { name, photo, mask, lens, pose, prescaled });
    Ok(())
}

/// The mask that the frame names, else one in `masks/`.
fn mask(
    root: &Path,
    frame: &FrameJson,
    name: &str,
    path: &Path,
    index: usize,
) -> Result<Option<PathBuf>, DatasetError> {
    let Some(given) = &frame.mask_path else {
        let inner = name.split_once('/').map_or(name, |(_, rest)| rest);
        return Ok(find_mask(root, name).or_else(|| find_mask(root, inner)));
    };
    let mask = clean_name(given).map(|name| root.join(name)).filter(|mask| mask.is_file());
    mask.map(Some).ok_or_else(|| {
        let problem = format!("`{given}` is not a file inside the scene folder");
        DatasetError::field(path, format!("frames[{index}].mask_path"), problem)
    })
}

/// Names without extension get that of their photo.
fn with_extension(name: String, photo: &Path) -> String {
    let extension = photo.extension().unwrap_or_default().to_string_lossy();
    let file = photo.file_name().unwrap_or_default().to_string_lossy();
    let last = name.rsplit('/').next().unwrap_or_default();
    if file == format!("{last}.{extension}") { format!("{name}.{extension}") } else { name }
}

/// Metadata only. Frames with equal intrinsics count as one camera.
pub(crate) fn inspect(path: &Path) -> Result<SceneInfo, DatasetError> {
    let scene = read(path, &LoadOptions::default())?;
    let mut cameras: Vec<(Lens, usize)> = Vec::new();
    for frame in &scene.frames {
        match cameras.iter_mut().find(|(lens, _)| *lens == frame.lens) {
            Some((_, images)) => *images += 1,
            None => cameras.push((frame.lens, 1)),
        }
    }
    let cameras = cameras.iter().enumerate().map(|(index, (lens, images))| CameraInfo {
        id: index.to_string(),
        model: match (lens.is_fisheye(), lens.distortion.is_none()) {
            (true, _) => FISHEYE,
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
    });
    Ok(SceneInfo {
        path: path.to_owned(),
        kind: scene.kind,
        images: scene.frames.len() + scene.missing.len(),
        cameras: cameras.collect(),
        points: points::from_files(&scene.point_files)?.map_or(0, |cloud| cloud.points.len()),
        missing: scene.missing.iter().map(|path| path.display().to_string()).collect(),
    })
}
