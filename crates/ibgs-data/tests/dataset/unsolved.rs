//! Points, poses and cameras that a program could not solve: NaN, as Windows programs print it too.

use super::{assert_note, load_plain};
use ibgs_data::dataset;
use ibgs_testing::fails;
use ibgs_testing::scene_files::{Model, write_file};
use std::fs;
use std::path::Path;

/// A text model of four photos with one text in place of another in a file.
fn text_model(folder: &Path, file: &str, from: &str, to: &str) {
    let model = Model::small(4);
    model.write_text(folder);
    model.write_photos(folder);
    let path = folder.join("sparse").join(file);
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{text}");
    write_file(&path, text.replacen(from, to, 1));
}

#[test]
fn a_point_that_is_not_a_number_is_dropped() {
    for nan in ["-nan(ind)", "nan", "-nan", "NaN", "-1.#IND", "1.#QNAN0", "nan(snan)", "inf", "1.#INF"] {
        let folder = tempfile::tempdir().unwrap();
        text_model(folder.path(), "points3D.txt", "1 0.1 0.5 3.0", &format!("1 {nan} {nan} {nan}"));
        let dataset = load_plain(folder.path());
        assert_eq!((dataset.points.len(), dataset.views.len()), (1, 4), "{nan}");
        assert_note(&dataset, "1 initial points are not finite and were dropped");
    }
    let folder = tempfile::tempdir().unwrap();
    text_model(folder.path(), "points3D.txt", "1 0.1 0.5 3.0", "1 nano 0.5 3.0");
    fails(folder.path(), &["points3D.txt", "line 2", "`nano` is not a valid number"]);
}

#[test]
fn a_photo_whose_pose_is_not_a_number_is_left_out() {
    let (text, binary) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let mut model = Model::small(4);
    let row = "2 0.9 0.1 -0.2 0.05 0.25 -0.1 2.0";
    let nan = "-nan(ind)";
    text_model(text.path(), "images.txt", row, &format!("2 {nan} {nan} {nan} {nan} {nan} {nan} {nan}"));
    model.images[1].q = [f64::NAN; 4];
    model.images[1].t = [f64::NAN; 3];
    model.write_binary(binary.path());
    model.write_photos(binary.path());
    for (scene, file) in [(text.path(), "images.txt"), (binary.path(), "images.bin")] {
        let dataset = load_plain(scene);
        let names: Vec<&str> = dataset.views.iter().map(|view| view.name.as_str()).collect();
        assert_eq!(names, ["a0.png", "a2.png", "a3.png"]);
        let note = format!("1 photo of {file} has a pose or camera that is not a number and is left out: a1.png");
        assert_eq!(dataset.notes, [note.as_str()]);
        let info = dataset::inspect(scene).unwrap();
        assert_eq!((info.images, info.unposed.len(), info.notes, info.refused), (3, 0, vec![note], None));
        assert_eq!(dataset::load_poses(scene, &Default::default()).unwrap().views.len(), 3);
    }
    // Where nothing is left, the reason is said.
    model.images.iter_mut().for_each(|image| image.t[1] = f64::NAN);
    model.write_binary(binary.path());
    fails(binary.path(), &["images.bin", "image `a0.png`", "the pose is not finite"]);
    assert!(dataset::inspect(binary.path()).unwrap().refused.unwrap().contains("the pose is not finite"));
}

#[test]
fn photos_of_a_camera_that_is_not_a_number_are_left_out() {
    let mut model = Model::small(4);
    let mut broken = model.cameras[0].clone();
    (broken.id, broken.params[0]) = (2, f64::NAN);
    model.cameras.push(broken);
    model.images[0].camera = 2;
    model.images[3].camera = 2;
    let (text, binary) = (tempfile::tempdir().unwrap(), model.scene());
    model.write_text(text.path());
    model.write_photos(text.path());
    let cameras = fs::read_to_string(text.path().join("sparse/cameras.txt")).unwrap();
    write_file(&text.path().join("sparse/cameras.txt"), cameras.replace("NaN", "-nan(ind)"));
    for scene in [text.path(), binary.path()] {
        let dataset = load_plain(scene);
        assert_eq!((dataset.views.len(), dataset.views[0].name.as_str()), (2, "a1.png"));
        assert_note(&dataset, "have a pose or camera that is not a number and are left out: a0.png, a3.png");
    }
}
