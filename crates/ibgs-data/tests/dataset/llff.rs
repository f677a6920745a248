//! Scenes of LLFF: `poses_bounds.npy` and photos in the order of their names.

use super::{assert_note, load, load_plain};
use glam::{DMat3, DQuat, DVec2, DVec3};
use ibgs_data::dataset::{self, LoadOptions, Resolution};
use ibgs_testing::scene_files::{Model, npy, write_file, write_photo, zip_of_folder};
use ibgs_testing::{fails, fails_with};
use std::fs;
use std::path::Path;

const NAMES: [&str; 3] = ["IMG_1.JPG", "IMG_10.JPG", "IMG_2.JPG"];
const FOCAL: f64 = 50.0;
const SIZE: [u32; 2] = [64, 48];

/// Axes of a camera in the world as columns, right, up, backward; and its place.
fn camera(index: usize) -> (DMat3, DVec3) {
    let at = index as f64;
    let axes = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.2 + at, -0.4 * at, 0.7));
    (axes, DVec3::new(at - 1.0, 0.3, -2.0 * at))
}

/// A row of the file.
fn row(index: usize) -> Vec<f64> {
    let (axes, place) = camera(index);
    let columns = [-axes.y_axis, axes.x_axis, axes.z_axis, place];
    let last = [f64::from(SIZE[1]), f64::from(SIZE[0]), FOCAL];
    let mut row: Vec<f64> = (0..3).flat_map(|r| columns.map(|c| c[r]).into_iter().chain([last[r]])).collect();
    row.extend([0.5, 20.0]);
    row
}

fn rows() -> Vec<f64> {
    (0..3).flat_map(row).collect()
}

/// Photos in a folder, of a size and with a colour for each.
fn write_photos(folder: &Path, names: [&str; 3], [w, h]: [u32; 2]) {
    for (name, level) in names.into_iter().zip([40, 120, 200]) {
        write_photo(&folder.join(name), w, h, |_, _| [level, 9, 9, 255]);
    }
}

fn scene() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_photos(&folder.path().join("images"), NAMES, SIZE);
    write_photos(&folder.path().join("images_4"), ["image000.png", "image001.png", "image002.png"], [16, 12]);
    write_file(&folder.path().join("poses_bounds.npy"), npy(17, &rows()));
    folder
}

#[test]
fn a_scene_of_llff() {
    let folder = scene();
    let random = LoadOptions { random_points: 30, ..LoadOptions::default() };
    let dataset = load(folder.path(), &random);
    assert_note(&dataset, "30 random ones stand in");
    assert_eq!(dataset.views.iter().map(|view| view.name.as_str()).collect::<Vec<_>>(), NAMES);
    let reduced = load(folder.path(), &LoadOptions { resolution: Resolution::Factor(4), ..random.clone() });
    assert_note(&reduced, "photos come from images_4 as they are");
    for (index, (whole, small)) in dataset.views.iter().zip(&reduced.views).enumerate() {
        let (axes, place) = camera(index);
        assert!(whole.camera.center().distance(place) < 1e-9);
        assert_eq!([whole.camera.width, whole.camera.height], SIZE);
        assert_eq!([small.camera.width, small.camera.height], [16, 12]);
        // Names are those of the whole photos, so that a split serves both.
        assert_eq!(whole.name, small.name);
        let [a, b] = [whole, small].map(|view| view.photo.pixels().unwrap().rgba[0]);
        assert!(a.abs_diff(b) < 3, "{a} {b}");
        // A point right of, above and in front of the camera.
        for (right, up, depth) in [(0.0, 0.0, 2.0), (0.5, 0.25, 3.0), (-1.0, 0.4, 8.0)] {
            let point = place + axes * DVec3::new(right, up, -depth);
            let expected = DVec2::new(32.0 + FOCAL * right / depth, 24.0 - FOCAL * up / depth);
            let (seen, at) = whole.camera.project(point);
            assert!(seen.distance(expected) < 1e-9 && (at - depth).abs() < 1e-9, "{seen} for {expected}");
            assert!(small.camera.project(point).0.distance(expected / 4.0) < 1e-9);
        }
    }
    let info = dataset::inspect(folder.path()).unwrap();
    assert_eq!((info.kind.word(), info.images, info.cameras.len()), ("llff", 3, 1));
    assert_eq!(info.listing.to_str(), Some("poses_bounds.npy"));
    // The file itself and an archive are the same scene.
    assert_eq!(load(&folder.path().join("poses_bounds.npy"), &random).views.len(), 3);
    let archive = tempfile::tempdir().unwrap();
    write_file(&archive.path().join("a.zip"), zip_of_folder(folder.path(), "top/"));
    assert_eq!(load(&archive.path().join("a.zip"), &random).views.len(), 3);
    // A mask by the photo's name.
    write_photo(&folder.path().join("masks/IMG_10.png"), 64, 48, |_, _| [0, 0, 0, 255]);
    assert!(load(folder.path(), &random).views[1].photo.pixels().unwrap().is_wholly_masked());
}

#[test]
fn a_colmap_model_comes_first() {
    let folder = Model::small(3).scene();
    write_file(&folder.path().join("poses_bounds.npy"), b"nothing");
    assert_eq!(dataset::inspect(folder.path()).unwrap().kind.word(), "colmap_binary");
    assert_eq!(load_plain(folder.path()).views.len(), 3);
}

#[test]
fn poses_that_make_no_sense() {
    let folder = scene();
    let path = folder.path().join("poses_bounds.npy");
    let refused = |change: &dyn Fn(&mut Vec<f64>), fragments: &[&str]| {
        let mut rows = rows();
        change(&mut rows);
        write_file(&path, npy(17, &rows));
        fails(folder.path(), &[&["poses_bounds.npy"], fragments].concat());
    };
    refused(&|rows| rows[17 + 3] = f64::NAN, &["row 1", "not finite"]);
    refused(&|rows| rows[14] = 0.0, &["row 0", "focal length"]);
    refused(&|rows| rows[4] = 0.5, &["row 0", "64 x 0.5 is not a number of pixels"]);
    refused(&|rows| rows[2 * 17] += 1.0, &["row 2", "not a rotation"]);
    refused(&|rows| rows.truncate(34), &["has 2 poses", "images has 3 photos"]);
    write_file(&path, npy(15, &[0.5; 45]));
    fails(folder.path(), &["poses_bounds.npy", "[3, 15]", "17 numbers"]);
    let whole = npy(17, &rows());
    write_file(&path, &whole[..whole.len() - 1]);
    fails(folder.path(), &["poses_bounds.npy", "truncated"]);
    write_file(&path, b"text");
    fails(folder.path(), &["poses_bounds.npy", "array of NumPy"]);
    write_file(&path, whole);
    fs::remove_file(folder.path().join("images_4/image001.png")).unwrap();
    let factor = LoadOptions { resolution: Resolution::Factor(4), ..LoadOptions::default() };
    fails_with(folder.path(), &factor, &["has 3 poses", "images_4 has 2 photos"]);
    fs::rename(folder.path().join("images"), folder.path().join("photos")).unwrap();
    fails(folder.path(), &["images does not exist"]);
    let named = LoadOptions { images: Some("photos".to_owned()), random_points: 9, ..LoadOptions::default() };
    assert_eq!(load(folder.path(), &named).views.len(), 3);
}
