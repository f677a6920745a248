//! Every reader of untrusted bytes, for the property tests and for the fuzzer in `fuzz/`. Each takes the contents of
//! a file, reads it and checks what holds of all contents: what is accepted makes sense, what is not has a sentence that
//! names the file. Whether it was accepted comes back.

use super::seeds;
use ibgs_core::blocks::BlockPlan;
use ibgs_core::bundle::Bundle;
use ibgs_core::camera::Camera;
use ibgs_core::camera_path::{CameraPath, KeyframePath};
use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::{self, Dataset, LoadOptions, Loaders, SceneFile};
use ibgs_core::local_space::LocalSpace;
use ibgs_core::output::figures::Figures;
use ibgs_core::output::{OutputFolder, cameras, multi_view};
use ibgs_core::residual::state_dict::StateDict;
use ibgs_core::scene::{self, Gaussians};
use ibgs_train::checkpoint::Checkpoint;
use ibgs_train::lpips::LpipsWeights;
use std::fmt::Display;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Calls a macro with the readers that are functions of this file.
macro_rules! each_reader {
    ($what:ident) => {
        $what! {
            transforms_json, ply, gaussians, camera_path, bundle, checkpoint, pth, safetensors, zip_scene, photo, config,
            model_folder, plan
        }
    };
}

macro_rules! table {
    ($($name:ident),*) => { [$((stringify!($name), $name as fn(&[u8]) -> bool)),*] };
}

/// Reads the contents of a file and says whether they were accepted.
pub type Reader = Box<dyn Fn(&[u8]) -> bool + Send + Sync>;

/// All readers by name: those of this file, and one for each file of scenes that is checked by itself.
pub fn all() -> Vec<(&'static str, Reader)> {
    let functions = each_reader!(table).map(|(name, read)| (name, Box::new(read) as Reader));
    let of_scenes = |file: SceneFile| (file.name, Box::new(move |bytes: &[u8]| scene_file(file, bytes)) as Reader);
    functions.into_iter().chain(Loaders::default().files().into_iter().map(of_scenes)).collect()
}

/// Whether it was accepted; an error names the file.
fn accepted<T, E: Display>(result: Result<T, E>, name: &str, check: impl FnOnce(T)) -> bool {
    match result {
        Ok(value) => {
            check(value);
            true
        }
        Err(error) => {
            let text = error.to_string();
            assert!(text.contains(name), "`{name}` is not in: {text}");
            false
        }
    }
}

/// The first byte chooses, the rest is the file.
fn choice<'a, T: Copy>(bytes: &'a [u8], of: &[T]) -> Option<(T, &'a [u8])> {
    let (first, rest) = bytes.split_first()?;
    Some((of[usize::from(*first) % of.len()], rest))
}

/// A folder in memory where there is such a thing.
fn folder() -> TempDir {
    let shared = Path::new("/dev/shm");
    if shared.is_dir() { tempfile::tempdir_in(shared) } else { tempfile::tempdir() }.unwrap()
}

fn in_file(name: &str, bytes: &[u8], read: impl FnOnce(PathBuf) -> bool) -> bool {
    let folder = folder();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    read(path)
}

fn scene_file(file: SceneFile, bytes: &[u8]) -> bool {
    accepted((file.check)(Path::new(file.name), bytes), file.name, |count| assert!(count <= bytes.len()))
}

fn check_camera(camera: &Camera) {
    let single = [camera.center(), camera.translation].map(|v| v.as_vec3());
    assert!(camera.width > 0 && camera.height > 0 && single.iter().all(|v| v.is_finite()), "{camera:?}");
    let [focal, principal] = [camera.focal, camera.principal].map(|v| v.as_vec2());
    assert!(focal.is_finite() && focal.min_element() > 0.0 && principal.is_finite(), "{camera:?}");
}

fn check_gaussians(gaussians: &Gaussians) {
    gaussians.validate().unwrap();
    let space = LocalSpace::of_points(gaussians.positions()).unwrap_or(gaussians.space);
    gaussians.clone().into_space(space).validate().unwrap();
}

/// A scene that loaded can be started from.
fn check_dataset(dataset: &Dataset) {
    for view in &dataset.views {
        check_camera(&view.camera);
        let [w, h] = [view.camera.width, view.camera.height];
        assert_eq!(
            (
                view.photo.pixels().unwrap().width,
                view.photo.pixels().unwrap().height,
                view.photo.pixels().unwrap().rgba.len()
            ),
            (w, h, 4 * w as usize * h as usize)
        );
        assert!(!view.name.starts_with('/') && !view.name.split('/').any(|part| part == ".."), "{}", view.name);
    }
    assert!(dataset.train.len() >= 2 && !dataset.points.is_empty());
    let space = dataset.space();
    dataset.views.iter().for_each(|view| check_camera(&space.camera(&view.camera)));
    let points: Vec<_> = dataset.points.iter().map(|point| point.to_local(&space)).collect();
    check_gaussians(&scene::from_points(&points, 1, 0.1).unwrap());
}

fn few_points() -> LoadOptions {
    LoadOptions { random_points: 8, ..LoadOptions::default() }
}

/// `transforms.json` beside two photos.
pub fn transforms_json(bytes: &[u8]) -> bool {
    thread_local!(static FOLDER: TempDir = {
        let folder = folder();
        seeds::transforms_photos(folder.path());
        folder
    });
    FOLDER.with(|folder| {
        fs::write(folder.path().join("transforms.json"), bytes).unwrap();
        let name = folder.path().to_str().unwrap();
        accepted(dataset::inspect(folder.path()), name, |_| ());
        accepted(dataset::load(folder.path(), &few_points()), name, |dataset| check_dataset(&dataset))
    })
}

/// A PLY of Gaussians, and one of points.
pub fn ply(bytes: &[u8]) -> bool {
    let path = Path::new("some.ply");
    let read = scene::read_ply_from(&mut Cursor::new(bytes), bytes.len() as u64, path);
    let gaussians = accepted(read, "some.ply", |gaussians| check_gaussians(&gaussians));
    let read = dataset::parse_points_ply(path, bytes);
    accepted(read, "some.ply", |points| assert!(points.len() <= bytes.len())) || gaussians
}

/// A file of Gaussians of any format, with a name whose ending the first byte chooses.
pub fn gaussians(bytes: &[u8]) -> bool {
    let Some((ending, bytes)) = choice(bytes, &seeds::endings()) else { return false };
    let name = format!("some{ending}");
    let read = scene::read_gaussians_from(&mut Cursor::new(bytes), bytes.len() as u64, Path::new(&name));
    accepted(read, &name, |gaussians| check_gaussians(&gaussians))
}

/// A camera path, its frames and its keyframes.
pub fn camera_path(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let frames = accepted(CameraPath::parse(text), "", |path| path.cameras.iter().for_each(check_camera));
    accepted(KeyframePath::parse(text), "", |path| {
        for step in 0..8 {
            check_camera(&path.camera_at(path.seconds * f64::from(step) / 7.0).unwrap());
        }
        if path.frame_count() < 100 {
            let folder = folder();
            let file = folder.path().join("path.json");
            path.save(&file).unwrap();
            KeyframePath::load(&file).unwrap();
        }
    }) || frames
}

/// The bytes, where they are an archive; otherwise a whole archive in which they stand for the part that the first byte
/// chooses.
fn archive(bytes: &[u8], mut parts: seeds::Parts) -> Option<Vec<u8>> {
    if bytes.starts_with(b"PK") {
        return Some(bytes.to_vec());
    }
    let (first, rest) = bytes.split_first()?;
    let at = usize::from(*first) % parts.len();
    parts[at].1 = rest.to_vec();
    Some(seeds::stored_zip(&parts))
}

/// A checkpoint.
pub fn checkpoint(bytes: &[u8]) -> bool {
    let Some(bytes) = archive(bytes, seeds::checkpoint_parts()) else { return false };
    let read = Checkpoint::read_from(Cursor::new(&bytes), Path::new("1.ibgs"));
    accepted(read, "1.ibgs", |checkpoint| {
        assert!(checkpoint.gaussians.means.len() <= bytes.len() && checkpoint.network.is_none());
    })
}

/// A bundle.
pub fn bundle(bytes: &[u8]) -> bool {
    let Some(bytes) = archive(bytes, seeds::bundle_parts()) else { return false };
    let read = Bundle::read_from(Cursor::new(&bytes), Path::new("some.ibgs"));
    accepted(read, "some.ibgs", |bundle| {
        check_gaussians(&bundle.gaussians);
        bundle.cameras.iter().for_each(|record| check_camera(&record.camera));
        bundle.photos.iter().for_each(|(_, photo)| {
            let photo = photo.pixels().unwrap();
            assert_eq!(photo.rgba.len(), 4 * photo.width as usize * photo.height as usize);
        });
    })
}

fn state_dict(path: &Path) -> bool {
    let name = path.to_str().unwrap();
    let read = StateDict::open(path).and_then(|file| {
        let values = file.tensor(seeds::TENSOR, &seeds::TENSOR_SHAPE)?;
        // Sizes that no such small file holds are refused before anything is read.
        assert!(file.tensor(seeds::TENSOR, &[1 << 40]).is_err() || values.is_none());
        Ok(values)
    });
    let weights = LpipsWeights::load(&[path.to_owned()]).unwrap_err().to_string();
    assert!(weights.contains(name), "{weights}");
    let size: usize = seeds::TENSOR_SHAPE.iter().product();
    let mut found = false;
    let sound = accepted(read, name, |values: Option<Vec<f32>>| {
        found = values.is_some();
        assert!(values.is_none_or(|values| values.len() == size));
    });
    sound && found
}

/// A PyTorch state dict; where the first byte is odd, a whole archive of it with the rest as its pickle.
pub fn pth(bytes: &[u8]) -> bool {
    let Some((first, rest)) = bytes.split_first() else { return false };
    if first % 2 == 0 {
        return in_file("some.pth", rest, |path| state_dict(&path));
    }
    in_file("some.pth", &seeds::pth_of(rest), |path| state_dict(&path))
}

/// Weights in a safetensors file.
pub fn safetensors(bytes: &[u8]) -> bool {
    in_file("some.safetensors", bytes, |path| state_dict(&path))
}

/// A scene in a ZIP archive.
pub fn zip_scene(bytes: &[u8]) -> bool {
    in_file("scene.zip", bytes, |path| {
        let loaded = dataset::load(&path, &few_points());
        let read = accepted(loaded, path.to_str().unwrap(), |dataset| check_dataset(&dataset));
        let beside = fs::read_dir(path.parent().unwrap()).unwrap().count();
        assert_eq!(beside, 1, "something was written beside the archive");
        read
    })
}

/// A photo: PNG, JPEG, EXR, WebP, TIFF.
pub fn photo(bytes: &[u8]) -> bool {
    let read = dataset::decode_photo(Path::new("some.photo"), bytes, &LoadOptions::default());
    accepted(read, "some.photo", |photo| {
        assert_eq!(photo.rgba.len(), 4 * photo.width as usize * photo.height as usize);
    })
}

/// `config.toml`: what is accepted comes back as it was written.
pub fn config(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let path = Path::new("config.toml");
    accepted(TrainConfig::from_text(text, path), "config.toml", |config| {
        let text = config.to_text().unwrap();
        assert_eq!(TrainConfig::from_text(&text, path).unwrap(), config);
    })
}

/// The plan of a scene in blocks.
pub fn plan(bytes: &[u8]) -> bool {
    accepted(BlockPlan::from_json(bytes, Path::new("plan.json")), "plan.json", |plan| {
        assert!(!plan.blocks.is_empty());
    })
}

/// A JSON file of a model folder, chosen by the first byte.
pub fn model_folder(bytes: &[u8]) -> bool {
    let Some((name, bytes)) = choice(bytes, &seeds::MODEL_FILES) else { return false };
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    match name {
        "cameras.json" => accepted(cameras::from_json(text), "", |records| {
            records.iter().for_each(|record| check_camera(&record.camera));
        }),
        "multi_view.json" => accepted(multi_view::from_text(text), "", |_| ()),
        _ => in_file(name, bytes, |path| {
            let folder = OutputFolder::at(path.parent().unwrap());
            accepted(Figures::read(&folder, 7), name, |figures| {
                figures.speed.map(|speed| speed.storage_bytes.total());
            })
        }),
    }
}
