//! The output folder of a training run.

use glam::{DMat3, DQuat, DVec2, DVec3};
use ibgs_data::camera::Camera;
use ibgs_data::dataset::{Dataset, Masks, Photo, PointsFrom, View};
use ibgs_data::scene::{PlyFlavor, write_ply};
use ibgs_model::config::TrainConfig;
use ibgs_model::output::cameras::Split;
use ibgs_model::output::results::{Protocol, Scored, ViewScore};
use ibgs_model::output::{Existing, OutputError, OutputFolder};
use ibgs_testing::{header_length, random_gaussians, random_points};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fs;
use std::path::Path;

pub fn dataset() -> Dataset {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let names = ["a.0001.jpg", "left/b.png", "left/c.png"];
    let views = names.map(|name| {
        let axis = DVec3::from([0; 3].map(|_| rng.random_range(-1.0..1.0))).normalize();
        View {
            name: name.to_owned(),
            camera: Camera {
                width: 64,
                height: 48,
                focal: DVec2::new(50.0 / 3.0, 51.0 / 7.0),
                principal: DVec2::new(31.3, 22.9),
                view_from_world: DMat3::from_quat(DQuat::from_axis_angle(axis, rng.random())),
                translation: DVec3::from([0; 3].map(|_| rng.random_range(-9.0..9.0))),
            },
            photo: Photo { width: 64, height: 48, rgba: vec![255; 64 * 48 * 4] }.into(),
        }
    });
    Dataset {
        extent: None,
        masks: Masks::Ignore,
        backdrop: None,
        glossy: None,
        made_tracks: Default::default(),
        loaded_checksum: None,
        points_from: PointsFrom::Scene,
        path: "scene".into(),
        views: views.into(),
        train: vec![1, 2],
        test: vec![0],
        points: random_points(5, 12),
        notes: vec![],
    }
}

#[test]
fn output_folder_keeps_cameras_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let output = OutputFolder::create(&folder.path().join("new/run"), Existing::Keep).unwrap();
    let (config, dataset) = (TrainConfig { seed: 7, ..TrainConfig::default() }, dataset());
    output.write_start(&config, &dataset).unwrap();
    assert_eq!(output.read_config().unwrap(), config);
    let records = output.read_cameras().unwrap();
    assert_eq!(records.len(), 3);
    for (record, view) in records.iter().zip(&dataset.views) {
        assert_eq!((&record.name, record.camera), (&view.name, view.camera));
    }
    let splits: Vec<_> = records.iter().map(|record| record.split).collect();
    assert_eq!(splits, [Some(Split::Test), Some(Split::Train), Some(Split::Train)]);
    let split = fs::read_to_string(output.root().join("split.json")).unwrap();
    let split: serde_json::Value = serde_json::from_str(&split).unwrap();
    assert_eq!(split, serde_json::json!({"train": ["left/b.png", "left/c.png"], "test": ["a.0001.jpg"]}));
    let sources = output.read_multi_view().unwrap();
    let names: Vec<&str> = sources.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["a.0001.jpg", "left/b.png", "left/c.png"]);
    assert!(sources.iter().all(|view| !view.sources.contains(&view.name)));
    let points = fs::read(output.root().join("input.ply")).unwrap();
    assert_eq!(points.len() - header_length(&points), 5 * (6 * 4 + 3));

    let theirs = r#"[{"id":0,"img_name":"x","width":10,"height":6,"position":[1,2,3],
        "rotation":[[0,-1,0],[1,0,0],[0,0,1]],"fy":9.0,"fx":8.0}]"#;
    fs::write(output.cameras_path(), theirs).unwrap();
    let record = &output.read_cameras().unwrap()[0];
    assert_eq!((record.camera.principal, record.split), (DVec2::new(5.0, 3.0), None));
    assert!(record.camera.center().distance(DVec3::new(1.0, 2.0, 3.0)) < 1e-12);
    // The second column of `rotation` is the view's y axis in the world.
    assert!(record.camera.to_view(DVec3::new(0.0, 2.0, 3.0)).distance(DVec3::Y) < 1e-12);
    for (from, to, expected) in [("8.0", "0.0", "focal"), ("[0,0,1]]", "[0,0,2]]", "no rotation"), ("10", "-1", "line")]
    {
        fs::write(output.cameras_path(), theirs.replacen(from, to, 1)).unwrap();
        let text = output.read_cameras().unwrap_err().to_string();
        assert!(text.contains(expected) && text.contains("cameras.json"), "{text}");
    }
}

#[test]
fn output_folder_refuses_to_overwrite() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let output = OutputFolder::create(root, Existing::Keep).unwrap();
    assert!(matches!(OutputFolder::open(root), Err(OutputError::NoModel { .. })));
    output.write_start(&TrainConfig::default(), &dataset()).unwrap();
    // A run that saved nothing may be repeated.
    OutputFolder::create(root, Existing::Keep).unwrap();
    let model = random_gaussians(3, 0, 13);
    for iteration in [7, 100, 30] {
        write_ply(&output.point_cloud_path(iteration), &model, PlyFlavor::Full).unwrap();
    }
    fs::create_dir_all(root.join("point_cloud/iteration_500")).unwrap();
    assert_eq!(output.latest_iteration().unwrap(), Some(100));
    assert_eq!(OutputFolder::open(root).unwrap(), output);
    let text = OutputFolder::create(root, Existing::Keep).unwrap_err().to_string();
    assert!(text.contains("100 iterations"), "{text}");
    assert!(output.point_cloud_path(100).exists());
    fs::write(root.join("mine.txt"), "x").unwrap();
    OutputFolder::create(root, Existing::Replace).unwrap();
    assert_eq!(output.latest_iteration().unwrap(), None);
    assert!(root.join("mine.txt").exists());

    let scene = folder.path().join("scene");
    fs::create_dir(&scene).unwrap();
    fs::write(scene.join("split.json"), "{}").unwrap();
    let text = OutputFolder::create(&scene, Existing::Keep).unwrap_err().to_string();
    assert!(text.contains("split.json") && text.contains("scene folder"), "{text}");
    assert!(OutputFolder::create(&root.join("mine.txt"), Existing::Keep).is_err());
    assert!(matches!(OutputFolder::open(&root.join("nowhere")), Err(OutputError::NoModel { .. })));
}

#[test]
fn results_carry_their_protocol_and_keep_other_iterations() {
    let folder = tempfile::tempdir().unwrap();
    let output = OutputFolder::create(folder.path(), Existing::Keep).unwrap();
    let protocol = Protocol {
        resampler: "lanczos3".into(),
        factor: "2".into(),
        split: "every 8th".into(),
        principal_point: "true".into(),
        masks: "ignore".into(),
        device: "some adapter".into(),
        lpips: None,
    };
    let score =
        |name: &str, psnr, ssim| ViewScore { name: name.into(), psnr, aligned_psnr: psnr + 1.0, ssim, lpips: None };
    let scores = [score("a", 20.0, 0.5), score("left/b", 30.0, 0.75)];
    output.write_results(7, Scored::Base, &scores, &protocol).unwrap();
    output.write_results(30, Scored::Base, &[score("a", f64::INFINITY, 1.0)], &protocol).unwrap();
    let read = |name: &str| -> serde_json::Value {
        serde_json::from_str(&fs::read_to_string(folder.path().join(name)).unwrap()).unwrap()
    };
    let all = read("results_renders.json");
    assert_eq!((&all["ours_7"]["PSNR"], &all["ours_7"]["SSIM"]), (&25.0.into(), &0.625.into()));
    assert!(all["ours_7"]["LPIPS"].is_null() && all["ours_30"]["PSNR"].is_null());
    assert_eq!(all["ours_30"]["protocol"]["device"], "some adapter");
    assert_eq!(read("per_view_renders.json")["ours_7"]["PSNR"]["left/b"], 30.0);
    output.write_results(30, Scored::Final, &scores, &protocol).unwrap();
    assert_eq!(read("results_renders_aggregate.json")["ours_30"]["PSNR"], 25.0);
    assert_eq!(read("per_view_renders_aggregate.json")["ours_30"]["SSIM"]["left/b"], 0.75);
    assert!(read("results_renders.json") == all, "the base image's scores stay");
    fs::write(folder.path().join("results_renders.json"), "[]").unwrap();
    let text = output.write_results(8, Scored::Base, &scores, &protocol).unwrap_err().to_string();
    assert!(text.contains("results_renders.json"), "{text}");
    // A new run in the folder begins without figures.
    OutputFolder::create(folder.path(), Existing::Replace).unwrap();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn pictures_stay_in_their_folder() {
    let folder = tempfile::tempdir().unwrap();
    let output = OutputFolder::create(folder.path(), Existing::Keep).unwrap();
    let path = |name: &str| {
        let path = output.picture_path(Split::Test, 7, "renders", name);
        path.strip_prefix(folder.path().join("test/ours_7/renders")).unwrap().to_owned()
    };
    assert_eq!(path("left/a.b.JPG"), Path::new("left/a.b.png"));
    assert_eq!(path("frame.0001"), Path::new("frame.0001.png"));
    assert_eq!(path("../../x.png"), Path::new("x.png"));
    assert_eq!(path("/etc/x.png"), Path::new("etc/x.png"));
}
