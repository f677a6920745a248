//! `transforms.json` of instant-ngp and nerfstudio, and Blender's `transforms_train.json` with `transforms_test.json` or
//! `transforms_val.json`.
//!
//! Poses are camera-to-world with OpenGL axes; focal lengths come from `fl_x` or `camera_angle_x`; any intrinsic
//! may stand in the file or in a frame, the frame wins. Distortion follows nerfstudio: `k1 .. k4` are the factors
//! of `r^2 .. r^8`, and with `OPENCV_FISHEYE` (or instant-ngp's `is_fisheye`) of the angle's even powers.

mod lists;

use super::colmap::Colmap;
use super::decode::photo_size;
use super::error::{DatasetError, read_json};
use super::format::not_a_scene;
use super::info::Beside;
use super::lens::{Distortion, Lens, Pose, Projection};
use super::masks::MaskFinder;
use super::names::{Photo, PhotoFolders, RelativeTo, inside};
use super::photos::{AbsoluteNames, ListedPhoto};
use super::split::StatedSplit;
use super::{LoadOptions, Loader, Observations, Scene, SceneKind};
use glam::DVec2;
use lists::Lists;
use serde::Deserialize;
use std::collections::BTreeMap;
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
    train_filenames: Option<Vec<String>>,
    val_filenames: Option<Vec<String>>,
    test_filenames: Option<Vec<String>>,
    #[serde(flatten)]
    intrinsics: Intrinsics,
}

/// Camera models whose distortion is the polynomial of [`Distortion`].
const MODELS: [&str; 7] = ["PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "PERSPECTIVE", FISHEYE];
const FISHEYE: &str = "OPENCV_FISHEYE";

impl Intrinsics {
    /// This frame's values, and the file's where the frame has none. A focal length in the frame hides the file's in
    /// every form.
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

/// Blender's files: the training views, and those that may be held out, the usual ones first.
const TRAIN: &str = "transforms_train.json";
const HELD_OUT: [&str; 2] = ["transforms_test.json", "transforms_val.json"];

const TRANSFORMS: SceneKind = SceneKind::new("transforms", "transforms.json");
/// Blender's scenes.
const BLENDER: SceneKind = SceneKind::new("blender", "Blender transforms");

/// The files of a scene.
struct Listings {
    kind: SceneKind,
    /// The one that names the scene.
    first: PathBuf,
    /// Name and file of what is held out.
    held_out: Option<(&'static str, PathBuf)>,
    notes: Vec<String>,
}

fn listings(scene: &Path) -> Option<Listings> {
    let one = |first| Listings { kind: TRANSFORMS, first, held_out: None, notes: Vec::new() };
    if scene.is_file() && scene.extension().is_some_and(|extension| extension == "json") {
        return Some(one(scene.to_owned()));
    }
    let existing = |name: &str| Some(scene.join(name)).filter(|path| path.is_file());
    if let Some(path) = existing("transforms.json") {
        return Some(one(path));
    }
    let first = existing(TRAIN)?;
    let mut held_out = HELD_OUT.into_iter().filter_map(|name| Some((name, existing(name)?)));
    let used = held_out.next();
    let unused = used.iter().zip(held_out);
    let notes = unused.map(|((used, _), (name, _))| format!("{name} is not used: {used} lists the views to hold out"));
    Some(Listings { kind: BLENDER, notes: notes.collect(), first, held_out: used })
}

/// What is gathered while the files are read.
struct Reading<'a> {
    root: &'a Path,
    masks: MaskFinder<'a>,
    folders: PhotoFolders,
    frames: Vec<ListedPhoto>,
    missing: Vec<PathBuf>,
    point_files: Vec<PathBuf>,
    absolute: AbsoluteNames,
    notes: Vec<String>,
}

/// A `transforms.json`, or a folder with one or with Blender's files.
#[derive(Debug)]
pub(crate) struct Transforms;

impl Loader for Transforms {
    fn shown_by(&self) -> &str {
        "transforms.json or transforms_train.json"
    }

    fn is_scene(&self, path: &Path) -> bool {
        listings(path).is_some()
    }

    /// Reads the listing and finds its photos.
    fn read(&self, scene: &Path, options: &LoadOptions) -> Result<Scene, DatasetError> {
        let Listings { kind, first: listing, held_out, notes } = listings(scene).ok_or_else(|| not_a_scene(scene))?;
        let root = super::root(&listing);
        let folders = PhotoFolders::new(root, RelativeTo::Scene, options);
        if let Some(path) = folders.absent() {
            return Err(DatasetError::NoPhotoFolder { path });
        }
        let mut reading = Reading {
            root,
            masks: MaskFinder::new(root),
            folders,
            frames: Vec::new(),
            missing: Vec::new(),
            point_files: Vec::new(),
            absolute: AbsoluteNames::default(),
            notes,
        };
        let mut split = reading.read_file(&listing, options)?;
        if let Some((by, path)) = held_out {
            let training = reading.frames.len();
            reading.read_file(&path, options)?;
            let test = reading.frames[training..].iter().map(|frame| frame.name.clone()).collect();
            split = Some(StatedSplit { test, by, ..StatedSplit::default() });
        }
        let Reading { folders, frames, missing, point_files, absolute, mut notes, .. } = reading;
        notes.extend(folders.reduced_note().filter(|_| frames.iter().any(|frame| frame.prescaled)));
        notes.extend(absolute.note());
        let of_objects = kind == BLENDER;
        // Depths and normals lie among Blender's photos.
        let beside = if of_objects { Beside::Nowhere } else { Beside::SameFolders };
        Ok(Scene { missing, point_files, split, beside, of_objects, notes, ..Scene::new(kind, listing, frames) })
    }

    /// Those of the COLMAP model that nerfstudio keeps beside its file. There names begin within the folder of the photos.
    fn observations(&self, scene: &Path, options: &LoadOptions) -> Result<Observations, DatasetError> {
        let root = super::root(scene);
        if !Colmap::Nerfstudio.is_scene(root) {
            return Ok(Observations::default());
        }
        let mut observations = Colmap::Nerfstudio.observations(root, options)?;
        observations.photos.iter_mut().for_each(|photo| photo.name.insert_str(0, "images/"));
        Ok(observations)
    }
}

impl Reading<'_> {
    /// Adds the frames and the cloud of one file; gives the split that its lists state.
    fn read_file(&mut self, path: &Path, options: &LoadOptions) -> Result<Option<StatedSplit>, DatasetError> {
        let file: FileJson = read_json(path)?;
        let mut names = BTreeMap::new();
        for (index, frame) in file.frames.iter().enumerate() {
            let name = self.read_frame(path, index, frame, &file.intrinsics)?;
            lists::add_name(&mut names, &frame.file_path, name);
        }
        if let Some(given) = &file.ply_file_path {
            let is_file = |end: &str| self.root.join(end).is_file();
            let ply = inside(given, is_file).ok_or_else(|| {
                let problem = format!("`{given}` is absolute or leaves the scene folder");
                DatasetError::field(path, "ply_file_path", problem)
            })?;
            if is_file(&ply.name) {
                self.point_files.push(self.root.join(ply.name));
            } else {
                self.notes.push(format!("ply_file_path {} does not exist", self.root.join(ply.name).display()));
            }
        }
        // Without `eval` nothing depends on the lists.
        let lists = Lists { train: file.train_filenames, val: file.val_filenames, test: file.test_filenames };
        if options.eval { lists.split(path, &names) } else { Ok(None) }
    }

    /// Adds one frame; gives its name, or none where its photo is missing.
    fn read_frame(
        &mut self,
        path: &Path,
        index: usize,
        frame: &FrameJson,
        shared: &Intrinsics,
    ) -> Result<Option<String>, DatasetError> {
        let given = &frame.file_path;
        let bad_name = || DatasetError::ImageName { path: path.to_owned(), name: given.clone() };
        let (inside, photo) = self.folders.resolve(given).ok_or_else(bad_name)?;
        self.absolute.add(self.root, given, &inside);
        let name = inside.name;
        let intrinsics = frame.intrinsics.or(shared);
        let camera = format!("frames[{index}] (`{name}`)");
        if let Some(model) = intrinsics.unsupported_model() {
            return Err(DatasetError::CameraModel { path: path.to_owned(), camera, model });
        }
        let pose = Pose::from_opengl(&frame.transform_matrix)
            .map_err(|problem| DatasetError::field(path, format!("frames[{index}].transform_matrix"), problem))?;
        let (photo, prescaled) = match photo {
            Photo::Found(photo, prescaled) => (photo, prescaled),
            Photo::Missing(missing) => {
                self.missing.push(missing);
                return Ok(None);
            }
        };
        let lens = intrinsics
            .size(&photo)?
            .and_then(|size| intrinsics.lens(size))
            .map_err(|problem| DatasetError::Intrinsics { path: path.to_owned(), camera, problem })?;
        let mask = match &frame.mask_path {
            Some(given) => Some(named_mask(self.root, given, path, index)?),
            None => self.masks.find(&name, &photo),
        };
        let name = with_extension(name, &photo);
        self.frames.push(ListedPhoto { name: name.clone(), photo, mask, lens, pose, prescaled, key: None });
        Ok(Some(name))
    }
}

/// The mask that a frame names.
fn named_mask(root: &Path, given: &str, path: &Path, index: usize) -> Result<PathBuf, DatasetError> {
    let is_file = |end: &str| root.join(end).is_file();
    let mask = inside(given, is_file).filter(|mask| is_file(&mask.name));
    mask.map(|mask| root.join(mask.name)).ok_or_else(|| {
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
