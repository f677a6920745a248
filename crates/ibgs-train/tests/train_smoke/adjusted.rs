//! Cameras that are adjusted to the scene's observations before a training.

use super::poses::training_cameras;
use super::{dataset, plain};
use glam::{DQuat, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::camera_change::CameraChange;
use ibgs_core::config::{PoseSwitch, TrainConfig};
use ibgs_core::dataset::Dataset;
use ibgs_core::output::cameras::{self, CameraRecord};
use ibgs_core::similarity::Similarity;
use ibgs_reference::gpu::gpu;
use ibgs_testing::scene_files::{self, Image, Model, ModelPoint, PINHOLE};
use ibgs_train::Session;
use std::path::Path;

/// Turned by 0.3 degrees and moved by half a percent of the distance, each camera in another way.
fn disturbed(camera: &Camera, number: usize) -> Camera {
    let i = number as f64;
    let way = |a: f64| DVec3::new((2.4 * i + a).sin(), (2.4 * i + a).cos(), (1.1 * i - a).sin()).normalize();
    let (rotation, translation) = (way(0.0) * 0.3_f64.to_radians(), way(1.0) * 0.005 * camera.center().length());
    camera.changed(&CameraChange { rotation, translation, ..CameraChange::default() })
}

/// Writes a COLMAP model of the tiny demo: its photos' true observations, and cameras that are off.
fn write_scene(demo: &Dataset, folder: &Path, off: impl Fn(&Camera, usize) -> Camera) {
    let lens = demo.views[0].camera;
    let params = vec![lens.focal.x, lens.focal.y, lens.principal.x, lens.principal.y];
    let size = [lens.width, lens.height].map(u64::from);
    let image = |(number, view): (usize, &ibgs_core::dataset::View)| {
        let camera = off(&view.camera, number);
        let turn = DQuat::from_mat3(&camera.view_from_world);
        let seen = demo.points.iter().enumerate();
        let seen = seen.filter_map(|(i, point)| Some((view.camera.seen(point.position)?.0, i as i64 + 1)));
        let photo = view.photo.pixels().unwrap();
        let pixel = |x: f64, y: f64| {
            let at = 4 * (y as usize * photo.width as usize + x as usize);
            [photo.rgba[at], photo.rgba[at + 1], photo.rgba[at + 2], photo.rgba[at + 3]]
        };
        let name = format!("{number:02}.png");
        scene_files::write_photo(&folder.join("images").join(&name), photo.width, photo.height, pixel);
        Image {
            name,
            camera: 1,
            q: [turn.w, turn.x, turn.y, turn.z],
            t: camera.translation.to_array(),
            observations: seen.map(|(at, point)| (at.x, at.y, point)).collect(),
        }
    };
    let point = |point: &ibgs_core::dataset::Point| {
        // The reader looks up the images' own observations.
        ModelPoint { xyz: point.position.to_array(), rgb: point.color, error: 0.1, track: vec![(1, 0), (2, 0), (3, 0)] }
    };
    let model = Model {
        cameras: vec![scene_files::Camera { id: 1, model: PINHOLE, size, params }],
        images: demo.views.iter().enumerate().map(image).collect(),
        points: demo.points.iter().map(point).collect(),
    };
    model.write_binary(folder);
}

fn session(folder: &Path, refine: PoseSwitch) -> Session {
    let mut config = TrainConfig { source: Some(folder.to_owned()), ..plain(4) };
    config.data.eval = true;
    config.poses.refine = refine;
    Session::builder(config).build(&gpu(), &mut ()).unwrap()
}

/// Mean angle in degrees, and mean distance.
fn missed(found: &[Camera], truth: &[Camera]) -> [f64; 2] {
    let pairs: Vec<_> = truth.iter().copied().zip(found.iter().copied()).collect();
    let (frame, count) = (Similarity::fit(&pairs), pairs.len() as f64);
    pairs.iter().fold([0.0; 2], |[a, b], (truth, found)| {
        let (angle, distance) = frame.residual(truth, found);
        [a + angle.to_degrees() / count, b + distance / count]
    })
}

#[test]
fn a_training_begins_with_cameras_that_fit_the_observations() {
    let demo = dataset();
    let folder = tempfile::tempdir().unwrap();
    write_scene(&demo, folder.path(), disturbed);
    let [loaded, auto, on] =
        [PoseSwitch::Off, PoseSwitch::Auto, PoseSwitch::On].map(|refine| session(folder.path(), refine));
    let truth = |of: &Dataset| -> Vec<Camera> { of.train.iter().map(|&view| demo.views[view].camera).collect() };
    let [before, after] =
        [&loaded, &auto].map(|session| missed(&training_cameras(session.dataset()), &truth(session.dataset())));
    println!("degrees and distance from {before:?} to {after:?}; {:?}", auto.dataset().notes);
    assert!(before[0] > 0.1 && after[0] < 1e-3 && after[1] < 1e-3, "{before:?} {after:?}");
    assert_eq!(training_cameras(auto.dataset()), training_cameras(on.dataset()));
    assert!(auto.dataset().notes.iter().any(|note| note.starts_with("cameras: adjusted to ")));
    // The scene is the same one, a checkpoint belongs to either.
    assert_eq!(auto.dataset().checksum(), loaded.dataset().checksum());
    // Points come along, held-out cameras learn nothing from their own observations.
    let moved = loaded.dataset().points.iter().zip(&auto.dataset().points);
    assert!(moved.filter(|(a, b)| a.position != b.position).count() > 100);
    let held_out = auto.dataset().test[0];
    let camera = |session: &Session| session.dataset().views[held_out].camera;
    let (angle, _) = Similarity::IDENTITY.residual(&camera(&auto), &camera(&loaded));
    assert!(angle.to_degrees() < 0.1, "with the common frame alone: {angle}");
}

#[test]
fn cameras_that_fit_begin_as_they_are() {
    let demo = dataset();
    let folder = tempfile::tempdir().unwrap();
    write_scene(&demo, folder.path(), |camera, _| *camera);
    let [loaded, auto] = [PoseSwitch::Off, PoseSwitch::Auto].map(|refine| session(folder.path(), refine));
    assert_eq!(training_cameras(auto.dataset()), training_cameras(loaded.dataset()));
    assert!(auto.dataset().notes.iter().any(|note| note.starts_with("cameras: they fit ")));
}

#[test]
fn a_made_scene_brings_its_observations() {
    let demo = dataset();
    let truth = training_cameras(&demo);
    let mut off = demo.clone();
    for (number, view) in off.views.iter_mut().enumerate() {
        view.camera = disturbed(&disturbed(&view.camera, number), number);
    }
    let session = |dataset: &Dataset| {
        let mut config = plain(4);
        config.poses.refine = PoseSwitch::On;
        Session::builder(config).dataset(dataset.clone()).build(&gpu(), &mut ()).unwrap()
    };
    let [right, moved] = [&demo, &off].map(session);
    let says = |session: &Session, what: &str| {
        session
            .dataset()
            .notes
            .iter()
            .any(|note| note.starts_with(what) && note.contains("observations of the scene's points"))
    };
    assert!(says(&right, "cameras: they fit ") && says(&moved, "cameras: adjusted to "), "{:?}", moved.dataset().notes);
    assert_eq!(training_cameras(right.dataset()), truth);
    let [before, after] = [&off, moved.dataset()].map(|dataset| missed(&training_cameras(dataset), &truth));
    println!("degrees and distance from {before:?} to {after:?}");
    assert!(after[0] < 0.7 * before[0], "{before:?} {after:?}");
    // Points come along.
    assert!(demo.points.iter().zip(&moved.dataset().points).filter(|(a, b)| a.position != b.position).count() > 100);
}

#[test]
fn cameras_of_a_file_are_begun_with() {
    let demo = dataset();
    let folder = tempfile::tempdir().unwrap();
    write_scene(&demo, folder.path(), disturbed);
    let [loaded, auto] = [PoseSwitch::Off, PoseSwitch::Auto].map(|refine| session(folder.path(), refine));
    let path = folder.path().join("refined.json");
    let write = |records: &[CameraRecord]| std::fs::write(&path, cameras::to_json(records).to_string()).unwrap();
    let mut records = cameras::records(auto.dataset());
    write(&records);
    let mut config = TrainConfig { source: Some(folder.path().to_owned()), ..plain(4) };
    config.data.eval = true;
    config.poses.cameras = Some(path.clone());
    let build = |config: &TrainConfig| Session::builder(config.clone()).build(&gpu(), &mut ());
    let given = build(&config).unwrap();
    let all = |session: &Session| session.dataset().views.iter().map(|view| view.camera).collect::<Vec<_>>();
    assert_eq!(all(&given), all(&auto));
    assert_eq!(given.dataset().checksum(), loaded.dataset().checksum());
    // Points come along.
    let far = |session: &Session| {
        let pairs = session.dataset().points.iter().zip(&auto.dataset().points);
        ibgs_core::median(pairs.map(|(a, b)| a.position.distance(b.position)).collect()).unwrap()
    };
    assert!(far(&given) < 0.05 * far(&loaded), "{} of {}", far(&given), far(&loaded));

    let gone = records.pop().unwrap().name;
    write(&records);
    let error = build(&config).err().unwrap().to_string();
    assert!(error.contains("refined.json") && error.contains(&format!("no camera of the photo `{gone}`")), "{error}");
    config.poses.refine = PoseSwitch::Auto;
    let error = build(&config).err().unwrap().to_string();
    assert!(error.contains("poses.refine") && error.contains("`poses.cameras`"), "{error}");
}
