//! The loaders: formats, names, poses, split, points, options.

mod archive;
mod lists;
mod llff;
mod loaders;
mod masks;
mod models;
mod names;
mod neus;
mod points;
pub mod reality_capture;
mod splits;
mod tracks;
mod units;
mod unsolved;

use glam::{DMat3, DQuat, DVec2, DVec3};
use ibgs_data::dataset::{self, Alpha, Dataset, LoadOptions, Point, PrincipalPoint, Resolution};
use ibgs_testing::scene_files::{Camera, Image, Model, SIMPLE_PINHOLE, write_file, write_photo};
use std::f64::consts::FRAC_PI_2;
use std::path::Path;

/// Loads or fails the test with the message.
#[track_caller]
pub fn load(scene: &Path, options: &LoadOptions) -> Dataset {
    dataset::load(scene, options).unwrap_or_else(|error| panic!("{error}"))
}

/// With default options.
pub fn load_plain(scene: &Path) -> Dataset {
    load(scene, &LoadOptions::default())
}

/// Some note holds the fragment.
#[track_caller]
pub fn assert_note(dataset: &Dataset, fragment: &str) {
    let found = dataset.notes.iter().any(|note| note.contains(fragment));
    assert!(found, "`{fragment}` is not in {:?}", dataset.notes);
}

#[test]
fn text_and_binary_agree() {
    let model = Model::small(5);
    let (binary, text) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    model.write_binary(binary.path());
    model.write_text(text.path());
    model.write_photos(binary.path());
    model.write_photos(text.path());
    let (a, b) = (load_plain(binary.path()), load_plain(text.path()));
    assert_eq!(a.views.len(), 5);
    for (a, b) in a.views.iter().zip(&b.views) {
        assert_eq!((&a.name, a.camera), (&b.name, b.camera));
    }
    assert_eq!(a.points.len(), model.points.len());
    for ((a, b), point) in a.points.iter().zip(&b.points).zip(&model.points) {
        assert_eq!((a.position, a.color), (b.position, b.color));
        assert_eq!((a.position, a.color), (DVec3::from(point.xyz), point.rgb));
    }
    assert!(a.notes.is_empty(), "{:?}", a.notes);
    let camera = a.views[2].camera;
    assert_eq!(camera.focal, DVec2::new(10.0, 11.0));
    assert_eq!(camera.principal, DVec2::new(6.5, 3.75));
    assert_eq!(camera.translation, DVec3::from(model.images[2].t));
    let [w, x, y, z] = model.images[2].q;
    let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    assert_eq!(camera.view_from_world, rotation);
    let infos = [binary.path(), text.path()].map(|path| dataset::inspect(path).unwrap());
    assert_eq!(infos[0].cameras, infos[1].cameras);
    assert_eq!((infos[0].kind.word(), infos[1].kind.word()), ("colmap_binary", "colmap_text"));
    assert_eq!((infos[0].images, infos[0].points, infos[0].cameras[0].images), (5, 2, 5));
}

#[test]
fn text_lines_may_be_blank_or_end_in_crlf() {
    let mut model = Model::small(3);
    model.images[1].observations.clear();
    model.images[2].name = "with space.png".into();
    let folder = tempfile::tempdir().unwrap();
    model.write_photos(folder.path());
    model.write_text(folder.path());
    write_file(&folder.path().join("sparse/images.txt"), model.images_txt().replace('\n', "\r\n"));
    let names: Vec<String> = load_plain(folder.path()).views.into_iter().map(|v| v.name).collect();
    assert_eq!(names, ["a0.png", "a1.png", "with space.png"]);
}

#[test]
fn sub_folders_dots_and_two_cameras() {
    let mut model = Model::small(4);
    let names = ["left/b.0.1.png", "right/a.v2.final.jpg", "left/b.0.0.png", "a.png"];
    for (image, name) in model.images.iter_mut().zip(names) {
        image.name = name.into();
    }
    model.images[1].camera = 7;
    let params = vec![31.0, 14.5, 21.0];
    model.cameras.push(Camera { id: 7, model: SIMPLE_PINHOLE, size: [30, 40], params });
    let dataset = load_plain(model.scene().path());
    let order: Vec<&str> = dataset.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(order, ["a.png", "left/b.0.0.png", "left/b.0.1.png", "right/a.v2.final.jpg"]);
    let sizes: Vec<[u32; 2]> = dataset.views.iter().map(|view| [view.camera.width, view.camera.height]).collect();
    assert_eq!(sizes, [[12, 8], [12, 8], [12, 8], [30, 40]]);
    assert_eq!(dataset.views[3].camera.focal, DVec2::splat(31.0));
    assert_eq!(dataset.views[3].camera.principal, DVec2::new(14.5, 21.0));
}

#[test]
fn every_eighth_view_or_the_split_file() {
    let folder = Model::small(10).scene();
    let all = load_plain(folder.path());
    assert_eq!((all.train.len(), all.test.len()), (10, 0));
    let eval = LoadOptions { eval: true, ..Default::default() };
    let eighth = load(folder.path(), &eval);
    assert_eq!((eighth.train, eighth.test), (vec![1, 2, 3, 4, 5, 6, 7, 9], vec![0, 8]));
    let fourth = load(folder.path(), &LoadOptions { eval_split_every: 4, ..eval });
    assert_eq!(fourth.test, [0, 4, 8]);
    let split = r#"{"train": ["a3.png", "a1.png"], "test": ["a2.png"]}"#;
    write_file(&folder.path().join("split.json"), split);
    let given = load_plain(folder.path());
    assert_eq!((&given.train[..], &given.test[..]), (&[1, 3][..], &[2][..]));
    assert_note(&given, "2 training and 1 test views, 7 unused");
}

/// A `transforms.json` with `head` fields and frames of `(file_path, extra fields)` under one pose.
pub fn transforms(head: &str, frames: &[(&str, &str)]) -> String {
    let frames: Vec<String> = frames
        .iter()
        .map(|(path, extra)| {
            let pose = "[[0,0,1,5],[1,0,0,6],[0,1,0,7],[0,0,0,1]]";
            format!(r#"{{"file_path": "{path}", {extra} "transform_matrix": {pose}}}"#)
        })
        .collect();
    format!(r#"{{{head} "frames": [{}]}}"#, frames.join(","))
}

#[test]
fn transforms_json_forms() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["images/0.png", "images/sub/1.v2.png", "images/2.jpg"] {
        write_photo(&folder.path().join(name), 40, 30, |_, _| [5, 6, 7, 255]);
    }
    let path = folder.path().join("transforms.json");
    // Per file and per frame; a focal length in the frame hides the file's.
    let head = format!(r#""camera_angle_x": {FRAC_PI_2}, "cy": 14, "ply_file_path": "absent.ply","#);
    let frames = [
        ("./images/2", ""),
        ("images/0.png", r#""fl_x": 33, "fl_y": 34, "cx": 21, "w": 80.0, "h": 60,"#),
        ("images/sub/1.v2", r#""camera_angle_y": 1.0,"#),
        ("images/gone.png", ""),
    ];
    write_file(&path, transforms(&head, &frames));
    let dataset = load_plain(folder.path());
    let names: Vec<&str> = dataset.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["images/0.png", "images/2.jpg", "images/sub/1.v2.png"]);
    assert_note(&dataset, "1 of 4 photos do not exist");
    assert_note(&dataset, "gone.png");
    assert_note(&dataset, "absent.ply does not exist");
    let cameras: Vec<_> = dataset.views.iter().map(|view| view.camera).collect();
    assert_eq!(cameras[0].focal, DVec2::new(16.5, 17.0));
    assert_eq!(cameras[0].principal, DVec2::new(10.5, 7.0));
    assert!((cameras[1].focal - 20.0).length() < 1e-9);
    assert_eq!(cameras[1].principal, DVec2::new(20.0, 14.0));
    assert!((cameras[2].focal.y - 15.0 / 0.5_f64.tan()).abs() < 1e-9);
    // OpenGL axes: x right = world y, y up = world z, z backward = world x.
    assert!((cameras[1].center() - DVec3::new(5.0, 6.0, 7.0)).length() < 1e-9);
    assert!((cameras[1].forward() + DVec3::X).length() < 1e-9);
    assert!((cameras[1].view_from_world * DVec3::Y - DVec3::X).length() < 1e-9);
    assert!((cameras[1].view_from_world * DVec3::Z + DVec3::Y).length() < 1e-9);
    let info = dataset::inspect(&path).unwrap();
    assert_eq!((info.images, info.missing.len(), info.kind.word()), (4, 1, "transforms"));
}

#[test]
fn blender_scenes_keep_their_split() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["train/r_0.png", "train/r_1.png", "test/r_0.png"] {
        write_photo(&folder.path().join(name), 10, 10, |_, _| [5, 6, 7, 100]);
    }
    let head = r#""camera_angle_x": 0.7,"#;
    let train = transforms(head, &[("./train/r_0", ""), ("./train/r_1", "")]);
    write_file(&folder.path().join("transforms_train.json"), train);
    let test = transforms(head, &[("./test/r_0", "")]);
    write_file(&folder.path().join("transforms_test.json"), test);
    let eval = load(folder.path(), &LoadOptions { eval: true, ..Default::default() });
    assert_eq!((&eval.train[..], &eval.test[..]), (&[1, 2][..], &[0][..]));
    assert_eq!(eval.views[0].name, "test/r_0.png");
    // c alpha + background (1 - alpha) with alpha = 100 / 255, over black, over white, or not at all.
    let photo = eval.views[0].photo.pixels().unwrap();
    assert_eq!(photo.over([0.0; 3]).rgba[..4], [2, 2, 3, 255]);
    assert_eq!(photo.over([1.0; 3]).rgba[..4], [157, 157, 157, 255]);
    assert_note(&eval, "transparent pixels are empty");
    assert_eq!(eval.backdrop, Some((Alpha::Composite, [255; 3])));
    let masked = LoadOptions { alpha: Some(Alpha::Mask), ..Default::default() };
    assert_eq!(load(folder.path(), &masked).views[0].photo.pixels().unwrap().rgba[..4], [5, 6, 7, 100]);
    assert_eq!(load_plain(folder.path()).train.len(), 3);
}

/// Photos without alpha in the layout of Blender: of an object on one colour, or of a scene.
#[test]
fn blender_scenes_without_alpha_are_seen_for_what_they_show() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, photo: &dyn Fn(f64, f64) -> [u8; 3]| {
        write_photo(&folder.path().join(name), 16, 16, |u, v| {
            let [r, g, b] = photo(u, v);
            [r, g, b, 255]
        });
    };
    let thing = |u: f64, v: f64| {
        let inside = (u - 8.0).abs() < 3.0 && (v - 8.0).abs() < 3.0;
        if inside { [200, 100, 50] } else { [0; 3] }
    };
    let json = transforms(r#""camera_angle_x": 0.7,"#, &[("./train/r_0", ""), ("./train/r_1", "")]);
    write_file(&folder.path().join("transforms_train.json"), json);
    for name in ["train/r_0.png", "train/r_1.png"] {
        write(name, &thing);
    }
    assert_eq!(load_plain(folder.path()).backdrop, Some((Alpha::Keyed, [0; 3])));
    write("train/r_1.png", &|u, v| [(9.0 * u) as u8, (11.0 * v) as u8, 90]);
    assert_eq!(load_plain(folder.path()).backdrop, None);
}

/// A thing in the middle of transparent photos: random points lie on the rays through it, as far away as it can be.
#[test]
fn random_points_of_blender_scenes_show_the_thing() {
    let folder = tempfile::tempdir().unwrap();
    let thing = |u: f64, v: f64| {
        let inside = (u - 8.0).abs() < 2.0 && (v - 8.0).abs() < 2.0;
        if inside { [200, 100, 50, 255] } else { [9, 9, 9, 0] }
    };
    for name in ["train/r_0.png", "train/r_1.png"] {
        write_photo(&folder.path().join(name), 16, 16, thing);
    }
    let pose = |x: f64| format!("[[1,0,0,{x}],[0,1,0,0],[0,0,1,4],[0,0,0,1]]");
    let frame = |i: u32, x: f64| format!(r#"{{"file_path": "./train/r_{i}", "transform_matrix": {}}}"#, pose(x));
    let json = format!(r#"{{"camera_angle_x": 0.7, "frames": [{}, {}]}}"#, frame(0, -1.0), frame(1, 1.0));
    write_file(&folder.path().join("transforms_train.json"), json);
    let options = LoadOptions { random_points: 400, ..Default::default() };
    let dataset = load(folder.path(), &options);
    assert_note(&dataset, "400 random ones");
    let on_thing = dataset.points.iter().filter(|point| point.color == [200, 100, 50]).count();
    // Eight tries at a sixteenth of the pixels.
    assert!((120..260).contains(&on_thing), "{on_thing}");
    let extent = 1.1;
    let nearest = |p: &Point| dataset.views.iter().map(|v| v.camera.center().distance(p.position)).fold(9e9, f64::min);
    assert!(dataset.points.iter().all(|p| nearest(p) < 2.0 * extent + 1e-9));
}

#[test]
fn option_enums_round_trip() {
    let options = LoadOptions {
        resolution: Resolution::Width(1008),
        principal_point: PrincipalPoint::Centred,
        ..Default::default()
    };
    let json = serde_json::to_string(&options).unwrap();
    assert!(json.contains(r#""resolution":"1008""#) && json.contains(r#""centred""#), "{json}");
    assert_eq!(serde_json::from_str::<LoadOptions>(&json).unwrap(), options);
    assert!(serde_json::from_str::<LoadOptions>(r#"{"resolution": "3"}"#).is_err());
    assert_eq!("-1".parse::<Resolution>().unwrap(), Resolution::PublishedCap);
    assert_eq!(Resolution::default(), Resolution::Factor(1));
}

#[test]
fn unsupported_models_are_shown_by_inspect() {
    let mut model = Model::small(2);
    model.cameras[0].model = (11, "RAD_TAN_THIN_PRISM_FISHEYE");
    model.cameras[0].params = vec![1.0; 16];
    let image = Image { name: "gone.png".into(), ..model.images[0].clone() };
    let folder = model.scene();
    model.images.push(image);
    model.write_binary(folder.path());
    let info = dataset::inspect(folder.path()).unwrap();
    assert_eq!((info.cameras[0].model.as_str(), info.cameras[0].focal), ("RAD_TAN_THIN_PRISM_FISHEYE", None));
    assert_eq!(info.missing, ["gone.png"]);
    let refused = info.refused.unwrap();
    assert!(refused.contains("RAD_TAN_THIN_PRISM_FISHEYE is not supported; undistort the photos first"), "{refused}");
}

/// A panorama has two parameters, fewer than any other model, and no form as a pinhole.
#[test]
fn panoramas_are_refused_in_both_formats() {
    let mut model = Model::small(2);
    model.cameras[0].model = (17, "EQUIRECTANGULAR");
    model.cameras[0].params = vec![12.0, 8.0];
    let (binary, text) = (model.scene(), tempfile::tempdir().unwrap());
    model.write_text(text.path());
    model.write_photos(text.path());
    for scene in [binary.path(), text.path()] {
        let sentence =
            "camera 1: camera model EQUIRECTANGULAR is not supported; cut the panoramas into perspective photos";
        ibgs_testing::fails(scene, &["cameras.", sentence]);
        let info = dataset::inspect(scene).unwrap();
        assert_eq!((info.cameras[0].model.as_str(), info.cameras[0].focal), ("EQUIRECTANGULAR", None));
        assert!(info.refused.unwrap().contains(sentence));
    }
    // A model of a later COLMAP, of any number of parameters.
    for params in [vec![], vec![1.0; 20]] {
        model.cameras[0].model = (18, "LATER");
        model.cameras[0].params = params;
        model.write_binary(binary.path());
        let number =
            "camera model number 18 (COLMAP up to 4.1 has 0 to 17) is not supported; undistort the photos first";
        ibgs_testing::fails(binary.path(), &["cameras.bin", "camera 1 at byte", number]);
    }
}
