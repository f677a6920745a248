//! Names as other programs and systems write them: absolute, with backslashes, other extensions, spaces, byte order marks.

use super::{assert_note, load, load_plain, transforms};
use ibgs_data::dataset::{Dataset, LoadOptions};
use ibgs_testing::fails;
use ibgs_testing::scene_files::{Model, write_file, write_photo};
use std::fs;
use std::path::Path;

fn names(dataset: &Dataset) -> Vec<&str> {
    dataset.views.iter().map(|view| view.name.as_str()).collect()
}

/// A model of two photos with these names, without photos.
fn model_of(images: [&str; 2]) -> Model {
    let mut model = Model::small(2);
    model.images.iter_mut().zip(images).for_each(|(image, name)| image.name = name.to_owned());
    model
}

fn photo(path: &Path) {
    write_photo(path, 12, 8, |_, _| [9, 8, 7, 255]);
}

#[test]
fn photos_in_the_top_folder() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path();
    model_of(["a.png", "sub folder/b.png"]).write_binary(scene);
    for name in ["a.png", "sub folder/b.png", "c.png"] {
        photo(&scene.join(name));
    }
    for images in [None, Some("."), Some("./")] {
        let options = LoadOptions { images: images.map(str::to_owned), ..LoadOptions::default() };
        let dataset = load(scene, &options);
        assert_eq!(names(&dataset), ["a.png", "sub folder/b.png"]);
        assert_note(&dataset, "1 photo has no pose and is not used: c.png");
    }
    let json = transforms(r#""fl_x": 9,"#, &[("a.png", ""), ("./sub folder/b.png", "")]);
    write_file(&scene.join("nerf/transforms.json"), json);
    photo(&scene.join("nerf/a.png"));
    photo(&scene.join("nerf/sub folder/b.png"));
    let top = LoadOptions { images: Some(".".to_owned()), ..LoadOptions::default() };
    assert_eq!(names(&load(&scene.join("nerf"), &top)), ["a.png", "sub folder/b.png"]);
}

#[test]
fn names_that_begin_with_the_photo_folder() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path();
    model_of(["images/a.png", "images/left/b.png"]).write_binary(scene);
    for name in ["images/a.png", "images/left/b.png", "images_2/a.png", "images_2/left/b.png", "masks/left/b.png"] {
        photo(&scene.join(name));
    }
    let dataset = load_plain(scene);
    assert_eq!(names(&dataset), ["images/a.png", "images/left/b.png"]);
    assert_note(&dataset, "1 photo masked");
    let half = LoadOptions { resolution: "2".parse().unwrap(), ..LoadOptions::default() };
    let dataset = load(scene, &half);
    assert_note(&dataset, "photos come from images_2");
    // As large as they are in the folder.
    assert_eq!(dataset.views[1].camera.width, 12);
}

#[test]
fn absolute_names_are_looked_for_in_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path();
    photo(&scene.join("images/a.png"));
    photo(&scene.join("images/left/b.png"));
    let inside = scene.join("images/a.png").to_str().unwrap().to_owned();
    model_of([&inside, "left/b.png"]).write_binary(scene);
    let dataset = load_plain(scene);
    assert_eq!(names(&dataset), ["images/a.png", "left/b.png"]);
    assert!(dataset.notes.is_empty(), "{:?}", dataset.notes);
    model_of([r"D:\walk\images\left\b.png", "/home/me/walk/images/a.png"]).write_binary(scene);
    let dataset = load_plain(scene);
    assert_eq!(names(&dataset), ["images/a.png", "images/left/b.png"]);
    assert_note(&dataset, r"2 photos with absolute names of another place are taken from the scene folder");
    assert_note(&dataset, r"(first: D:\walk\images\left\b.png as images/left/b.png)");
    model_of(["/home/me/walk/images/gone.png", "a.png"]).write_binary(scene);
    fails(scene, &["images.bin", "/home/me/walk/images/gone.png", "absolute without a photo of that name"]);
    // Files outside of the scene are not read, whatever the name.
    let outside = tempfile::tempdir().unwrap();
    photo(&outside.path().join("secret.png"));
    let secret = outside.path().join("secret.png").to_str().unwrap().to_owned();
    fs::remove_dir_all(scene.join("sparse")).unwrap();
    let frames = |name: &str, extra: &str| transforms(r#""fl_x": 9,"#, &[("images/a.png", extra), (name, "")]);
    write_file(&scene.join("transforms.json"), frames(&secret, ""));
    fails(scene, &["transforms.json", "secret.png", "absolute without a photo of that name"]);
    let mask = format!(r#""mask_path": "{secret}","#);
    write_file(&scene.join("transforms.json"), frames("images/left/b.png", &mask));
    fails(scene, &["frames[0].mask_path", "not a file inside the scene"]);
    write_file(&scene.join("transforms.json"), frames("C:/walk/images/left/b.png", ""));
    assert_eq!(names(&load_plain(scene)), ["images/a.png", "images/left/b.png"]);
}

#[test]
fn marks_line_ends_and_separators_of_windows() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path();
    let model = model_of([r"left\a b.png", r".\Straße\ü.png"]);
    photo(&scene.join("images/left/a b.png"));
    photo(&scene.join("images/Straße/ü.png"));
    let windows = |text: String| format!("\u{feff}{}", text.replace('\n', "\r\n"));
    write_file(&scene.join("sparse/0/cameras.txt"), windows(model.cameras_txt()));
    write_file(&scene.join("sparse/0/images.txt"), windows(model.images_txt()));
    write_file(&scene.join("sparse/0/points3D.txt"), windows(model.points_txt()));
    let split = "\u{feff}{\"train\": [\"left\\\\a b.png\", \"./Straße/ü.png\"]}\r\n";
    write_file(&scene.join("split.json"), split);
    let dataset = load_plain(scene);
    assert_eq!(names(&dataset), ["Straße/ü.png", "left/a b.png"]);
    assert_eq!((dataset.train.len(), dataset.points.len()), (2, 2));
    write_file(&scene.join("sparse/0/images.txt"), b"\xef\xbb\xbf# \xff\n");
    fails(scene, &["images.txt", "byte 5", "UTF-8"]);
    fs::remove_dir_all(scene.join("sparse")).unwrap();
    fs::remove_file(scene.join("split.json")).unwrap();
    let json = transforms(
        r#""fl_x": 9, "ply_file_path": ".\\sub\\p.ply","#,
        &[(r"images\\left\\a b", ""), (r".\\images\\Straße\\ü.png", "")],
    );
    write_file(&scene.join("transforms.json"), windows(json));
    let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
    write_file(&scene.join("sub/p.ply"), windows(ply.to_owned()));
    let dataset = load_plain(scene);
    assert_eq!(names(&dataset), ["images/Straße/ü.png", "images/left/a b.png"]);
    assert_note(&dataset, "1 initial points from");
}

#[test]
fn extensions_in_other_cases_and_of_converted_photos() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path();
    model_of(["a.jpg", "b.HEIC"]).write_binary(scene);
    photo(&scene.join("images/a.JPG"));
    photo(&scene.join("images/b.png"));
    assert_eq!(names(&load_plain(scene)), ["a.jpg", "b.HEIC"]);
    // The converted photo is taken where both are there.
    write_file(&scene.join("images/b.HEIC"), b"\0\0\0\x18ftypheic\0\0\0\0mif1heic");
    assert_eq!(load_plain(scene).views.len(), 2);
    fs::remove_file(scene.join("images/b.png")).unwrap();
    fails(scene, &["b.HEIC is a HEIC file, which is not read", "`heif-convert`"]);
}
