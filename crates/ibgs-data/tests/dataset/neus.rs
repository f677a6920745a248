//! Scenes of NeuS: projections in an `.npz` file, photos in `image/`, masks in `mask/`.

use super::{assert_note, load, load_plain};
use glam::{DMat3, DQuat, DVec2, DVec3};
use ibgs_data::dataset::{self, LoadOptions};
use ibgs_testing::fails;
use ibgs_testing::scene_files::{npy, write_file, write_photo, zip_of};
use std::fs;
use std::path::Path;

const FOCAL: DVec2 = DVec2::new(92.5, 91.25);
const PRINCIPAL: DVec2 = DVec2::new(30.25, 26.5);
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                   end_header\n1 2 3\n";

/// Rotation and translation from the world to a camera.
fn pose(index: usize) -> (DMat3, DVec3) {
    let at = index as f64;
    let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3 * at, 2.0 - 0.5 * at, 0.1));
    (turn, DVec3::new(-20.0 + at, 13.0, 600.0))
}

fn calibration(skew: f64) -> DMat3 {
    let columns = [DVec3::new(FOCAL.x, 0.0, 0.0), DVec3::new(skew, FOCAL.y, 0.0), PRINCIPAL.extend(1.0)];
    DMat3::from_cols(columns[0], columns[1], columns[2])
}

/// `K [R | t]` times a factor, with a last row.
fn matrix(index: usize, factor: f64, skew: f64) -> Vec<f64> {
    let (turn, t) = pose(index);
    let (m, p) = (calibration(skew) * turn * factor, calibration(skew) * t * factor);
    let mut rows: Vec<f64> = (0..3).flat_map(|r| [m.row(r).x, m.row(r).y, m.row(r).z, p[r]]).collect();
    rows.extend([0.0, 0.0, 0.0, 1.0]);
    rows
}

/// The archive, as NeuS and IDR have it.
fn cameras(matrices: &[(&str, Vec<f64>)]) -> Vec<u8> {
    let arrays: Vec<(String, Vec<u8>)> =
        matrices.iter().map(|(name, values)| (format!("{name}.npy"), npy(4, values))).collect();
    let entries: Vec<(&str, &[u8])> = arrays.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
    zip_of(&entries)
}

fn three() -> Vec<(&'static str, Vec<f64>)> {
    vec![
        ("scale_mat_0", vec![f64::NAN; 16]),
        ("world_mat_2", matrix(2, -3.0, 0.0)),
        ("world_mat_0", matrix(0, 1.0, 0.0)),
        ("world_mat_inv_0", vec![0.0; 16]),
        ("world_mat_1", matrix(1, 0.01, 1e-9)),
        ("camera_mat_7", vec![1.0; 16]),
    ]
}

fn scene() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for index in 0..3 {
        let level = 40 * index as u8;
        write_photo(&folder.path().join(format!("image/{index:06}.png")), 64, 48, |_, _| [level, 9, 9, 255]);
        // White on the left half; names with fewer digits than the photos'.
        let mask = |x: f64, _: f64| if x < 32.0 { [255; 4] } else { [0, 0, 0, 255] };
        write_photo(&folder.path().join(format!("mask/{index:03}.png")), 64, 48, mask);
    }
    write_file(&folder.path().join("cameras_sphere.npz"), cameras(&three()));
    folder
}

#[test]
fn a_scene_of_neus() {
    let folder = scene();
    let random = LoadOptions { random_points: 30, ..LoadOptions::default() };
    let dataset = load(folder.path(), &random);
    assert_note(&dataset, "30 random ones stand in");
    for (index, view) in dataset.views.iter().enumerate() {
        assert_eq!(view.name, format!("{index:06}.png"));
        let (turn, t) = pose(index);
        for view_point in [DVec3::new(0.0, 0.0, 500.0), DVec3::new(60.0, -40.0, 650.0), DVec3::new(-90.0, 10.0, 580.0)]
        {
            let point = turn.transpose() * (view_point - t);
            let expected = FOCAL * view_point.truncate() / view_point.z + PRINCIPAL;
            let (seen, depth) = view.camera.project(point);
            assert!(seen.distance(expected) < 1e-6 && (depth - view_point.z).abs() < 1e-6, "{seen} for {expected}");
        }
        let rgba = &view.photo.pixels().unwrap().rgba;
        assert_eq!((rgba[3], rgba[4 * 63 + 3]), (255, 0), "the right half is masked");
    }
    let info = dataset::inspect(folder.path()).unwrap();
    // One camera, in spite of rounding in the matrices.
    assert_eq!((info.kind.word(), info.images, info.cameras.len(), info.points), ("neus", 3, 1, 0));
    write_file(&folder.path().join("sparse_points.ply"), PLY);
    assert_note(&load_plain(folder.path()), "1 initial points from");
    // The older name of the file, the file itself, and masks by name where there are not as many as photos.
    fs::rename(folder.path().join("cameras_sphere.npz"), folder.path().join("cameras.npz")).unwrap();
    fs::remove_file(folder.path().join("mask/001.png")).unwrap();
    fs::rename(folder.path().join("mask/002.png"), folder.path().join("mask/000002.png")).unwrap();
    let dataset = load_plain(&folder.path().join("cameras.npz"));
    let masked = |index: usize| dataset.views[index].photo.pixels().unwrap().rgba[4 * 63 + 3] == 0;
    assert_eq!([masked(0), masked(1), masked(2)], [false, false, true]);
}

#[test]
fn cameras_that_make_no_sense() {
    let folder = scene();
    let path = folder.path().join("cameras_sphere.npz");
    let refused = |matrices: &[(&str, Vec<f64>)], fragments: &[&str]| {
        write_file(&path, cameras(matrices));
        fails(folder.path(), &[&["cameras_sphere.npz"], fragments].concat());
    };
    let other = |values: Vec<f64>| {
        let mut matrices = three();
        matrices[4].1 = values;
        matrices
    };
    let mut nan = matrix(1, 1.0, 0.0);
    nan[7] = f64::NAN;
    refused(&other(nan), &["`world_mat_1`", "not finite"]);
    refused(&other(vec![0.0; 16]), &["`world_mat_1`", "no inverse"]);
    refused(&other(vec![1.0; 8]), &["`world_mat_1`", "[2, 4]"]);
    refused(&other(matrix(1, 1.0, 5.0)), &["`world_mat_1` (000001.png)", "skewed by 5.000 pixels"]);
    refused(&three()[..2], &["`world_mat_0` is missing", "`world_mat_2`"]);
    refused(&three()[..1], &["no matrix `world_mat_0`"]);
    refused(&[("world_mat_0", matrix(0, 1.0, 0.0))], &["has 1 poses", "image has 3 photos"]);
    let whole = cameras(&three());
    write_file(&path, &whole[..whole.len() / 2]);
    fails(folder.path(), &["cameras_sphere.npz", "NPZ archive"]);
    write_file(&path, whole);
    // Photos of half the size are not those of the cameras.
    write_photo(&folder.path().join("image/000001.png"), 28, 24, |_, _| [9; 4]);
    fails(folder.path(), &["`world_mat_1` (000001.png)", "lies outside of the photo of 28 x 24"]);
    fs::remove_dir_all(folder.path().join("image")).unwrap();
    fails(folder.path(), &["image does not exist"]);
    assert!(dataset::load(Path::new(folder.path()), &LoadOptions::default()).is_err());
}
