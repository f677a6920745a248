//! From a scene folder to a model, pictures, figures, and back in with every other command.

use super::{Sandbox, files_in, snapshot};
use glam::DVec3;
use ibgs_core::camera::Camera;
use serde_json::{Value, json};
use std::fs;

const PLY: &str = "point_cloud/iteration_30/point_cloud.ply";

#[test]
fn a_scene_becomes_a_model_that_every_command_reads() {
    let (sandbox, dataset) = Sandbox::with_scene();
    let trained = sandbox.succeeds("train scene --iterations 30 --eval -m model");
    assert!(trained.stderr.contains("8 training views, 2 test views, 300 initial points"), "{trained}");
    assert!(trained.stderr.contains("trained 30 iterations"), "{trained}");
    check_model_folder(&sandbox);
    info(&sandbox);
    render(&sandbox);
    render_camera_path(&sandbox, &dataset.views[0].camera);
    evaluate(&sandbox);
    bench(&sandbox);
}

/// Exactly the files that a run of 30 iterations leaves, and what is in them.
fn check_model_folder(sandbox: &Sandbox) {
    let pictures = |n: u32| {
        let names =
            ["gt", "renders"].map(|kind| ["000", "008"].map(|v| format!("test/ours_{n}/{kind}/images/view_{v}.png")));
        names.concat()
    };
    let mut expected: Vec<String> =
        ["cameras.json", "config.toml", "input.ply", "multi_view.json", "per_view_renders.json", PLY]
            .map(String::from)
            .into();
    // The first save and evaluation: 7,000 of 30,000 iterations, scaled.
    expected
        .extend(["point_cloud/iteration_7/point_cloud.ply", "results_renders.json", "split.json"].map(String::from));
    expected.extend(pictures(30));
    expected.extend(pictures(7));
    expected.sort();
    let mut found = files_in(&sandbox.path("model"));
    found.sort();
    assert_eq!(found, expected);

    let config = sandbox.text("model/config.toml");
    assert!(config.contains("iterations = 30\n") && config.contains("eval = true"), "{config}");
    let cameras = sandbox.json("model/cameras.json");
    assert_eq!((cameras.as_array().unwrap().len(), &cameras[0]["width"]), (10, &json!(48)));
    let split = sandbox.json("model/split.json");
    assert_eq!(split["test"], json!(["images/view_000.png", "images/view_008.png"]));
    assert_eq!(split["train"].as_array().unwrap().len(), 8);
    let results = &sandbox.json("model/results_renders.json")["ours_30"];
    let per_view = &sandbox.json("model/per_view_renders.json")["ours_30"]["PSNR"];
    let mean =
        (per_view["images/view_000.png"].as_f64().unwrap() + per_view["images/view_008.png"].as_f64().unwrap()) / 2.0;
    let psnr = results["PSNR"].as_f64().unwrap();
    assert!((psnr - mean).abs() < 1e-9 && psnr > 5.0, "{results}");
    assert!(results["SSIM"].as_f64().unwrap() > 0.0 && results["LPIPS"].is_null(), "{results}");
    assert_eq!(results["protocol"]["split"], "2 of 10 views, listed in split.json");
    for (kind, name) in [("gt", "view_000"), ("renders", "view_008")] {
        let picture = image::open(sandbox.path(&format!("model/test/ours_30/{kind}/images/{name}.png"))).unwrap();
        assert_eq!((picture.width(), picture.height()), (48, 36));
    }
    let photo = |path: &str| image::open(sandbox.path(path)).unwrap().into_rgb8();
    assert_eq!(photo("model/test/ours_30/gt/images/view_000.png"), photo("scene/images/view_000.png"));
}

fn info(sandbox: &Sandbox) {
    let scene = sandbox.succeeds("info scene");
    assert!(scene.stdout.contains("10 photos, 300 points") && scene.stdout.contains("48 x 36"), "{scene}");
    let model = sandbox.succeeds("info model");
    assert!(model.stdout.contains("model with 10 views") && model.stdout.contains("latest iteration 30"), "{model}");
    let ply = sandbox.succeeds(&format!("info model/{PLY}"));
    assert!(ply.stdout.contains(" Gaussians, spherical harmonics of degree 2"), "{ply}");
    let adapters = sandbox.succeeds("info");
    assert!(adapters.stdout.starts_with("0: ") && adapters.stdout.contains("usable             yes"), "{adapters}");
    assert!(adapters.stdout.contains("storage binding"), "{adapters}");
}

/// Rendering from the saved model gives the very pictures of the training's evaluation.
fn render(sandbox: &Sandbox) {
    let before = snapshot(&sandbox.path("model"));
    fs::remove_file(sandbox.path("model/test/ours_30/renders/images/view_000.png")).unwrap();
    sandbox.succeeds("render model");
    assert!(snapshot(&sandbox.path("model")) == before, "the pictures differ from those of the evaluation");
    sandbox.succeeds("render model --views train");
    assert_eq!(files_in(&sandbox.path("model/train/ours_30/renders")).len(), 8);
    sandbox.succeeds("render model --views all --iteration 7");
    assert_eq!(files_in(&sandbox.path("model/train/ours_7/renders")).len(), 8);
}

/// A frame at the pose of a view shows what the view shows.
fn render_camera_path(sandbox: &Sandbox, camera: &Camera) {
    let mut moved = *camera;
    moved.translation += DVec3::new(0.2, 0.0, 0.0);
    let keys = [camera, &moved].map(|c| {
        let axes = c.view_from_world.transpose();
        let (x, y, z, center) = (axes.x_axis, -axes.y_axis, -axes.z_axis, c.center());
        let rows = [0, 1, 2].map(|i| [x[i], y[i], z[i], center[i]]).concat();
        let matrix = [rows, vec![0.0, 0.0, 0.0, 1.0]].concat();
        let fov = 2.0 * (0.5 * f64::from(c.height) / c.focal.y).atan().to_degrees();
        json!({"camera_to_world": matrix, "fov": fov, "aspect": 4.0 / 3.0})
    });
    let file = json!({"camera_path": keys, "render_width": 48, "render_height": 36, "fps": 24, "seconds": 1.0});
    sandbox.write("path.json", file.to_string());
    sandbox.succeeds("render model --camera-path path.json");
    sandbox.succeeds("render model --camera-path path.json -o frames");
    assert_eq!(files_in(&sandbox.path("frames")), ["00000.png", "00001.png"]);
    let picture = |path: &str| image::open(sandbox.path(path)).unwrap().into_rgb8();
    let frame = picture("frames/00000.png");
    assert_eq!(frame, picture("model/path/ours_30/00000.png"));
    assert_ne!(frame, picture("frames/00001.png"));
    let view = picture("model/test/ours_30/renders/images/view_000.png");
    let largest = frame.iter().zip(view.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    assert!(largest <= 2, "frame and view differ by {largest} of 255");
}

/// Measuring the saved model repeats the figures of the training, from any folder.
fn evaluate(sandbox: &Sandbox) {
    let results = |name: &str| -> Value { sandbox.json(&format!("model/{name}")) };
    let before = [results("results_renders.json"), results("per_view_renders.json")];
    let outcome = sandbox.succeeds("eval model");
    let psnr = before[0]["ours_30"]["PSNR"].as_f64().unwrap();
    let line = outcome.stdout.lines().find(|line| line.starts_with("mean")).unwrap();
    assert!(line.contains(&format!("{psnr:.3}")), "{outcome}");
    assert!(
        outcome.stdout.contains("images/view_008.png") && outcome.stdout.contains("frames per second"),
        "{outcome}"
    );
    assert_eq!([results("results_renders.json"), results("per_view_renders.json")], before);

    fs::create_dir(sandbox.path("elsewhere")).unwrap();
    let mut command = sandbox.command("eval ../model --iteration 7");
    let outcome = super::Outcome::of("eval ../model", command.current_dir(sandbox.path("elsewhere")));
    outcome.assert_success();
    fs::rename(sandbox.path("scene"), sandbox.path("moved")).unwrap();
    sandbox.fails("eval model", &["scene"]);
    sandbox.succeeds("eval model --source moved");
    fs::rename(sandbox.path("moved"), sandbox.path("scene")).unwrap();
}

fn bench(sandbox: &Sandbox) {
    let outcome = sandbox.succeeds("bench --gaussians 500 --size 64x48 --iterations 2 --json bench.json");
    assert!(
        outcome.stdout.contains("500 Gaussians, 64 x 48") && outcome.stdout.contains("blend backward"),
        "{outcome}"
    );
    let report = sandbox.json("bench.json");
    assert_eq!((&report["gaussians"], &report["size"]), (&json!(500), &json!([64, 48])));
    assert!(report["frame_ms"].as_f64().unwrap() > 0.0 && report["iteration_ms"].as_f64().unwrap() > 0.0, "{report}");
    let stages = report["stages_ms"].as_array().unwrap();
    for name in ["project", "sort", "blend", "loss", "adam"] {
        assert!(stages.iter().any(|stage| stage["stage"] == name), "no {name} in {report}");
    }
    let outcome = sandbox.succeeds("bench model --iterations 1");
    assert!(outcome.stdout.contains("48 x 36"), "{outcome}");
}

#[test]
fn the_written_options_repeat_the_run_bit_for_bit() {
    let (sandbox, _) = Sandbox::with_scene();
    let options = "--iterations 60 --densify-start 10 --densify-interval 10 --densify-end 40 \
        --opacity-reset-interval 1000 --sh-degree 1 --seed 5 --white-background --save-iterations 20,60";
    sandbox.succeeds(&format!("train scene -m first {options}"));
    let model =
        |folder: &str| fs::read(sandbox.path(&format!("{folder}/point_cloud/iteration_60/point_cloud.ply"))).unwrap();
    assert!(sandbox.path("first/point_cloud/iteration_20/point_cloud.ply").is_file());
    assert!(!sandbox.path("first/test").exists() && !sandbox.path("first/results_renders.json").exists());
    sandbox.succeeds("train --config first/config.toml -m second");
    assert!(model("first") == model("second"), "the same options gave another model");
    assert_eq!(sandbox.text("first/config.toml"), sandbox.text("second/config.toml"));
    sandbox.succeeds("train --config first/config.toml -m third --seed 6");
    assert!(model("first") != model("third"), "another seed gave the same model");
}

#[test]
fn a_model_is_kept_unless_overwriting_is_asked_for() {
    let (sandbox, _) = Sandbox::with_model();
    sandbox.fails("train scene --iterations 2 -m model", &["model", "already holds a model trained for 3 iterations"]);
    sandbox.fails("train scene --iterations 2 -m scene/transforms.json", &["transforms.json", "another path"]);
    sandbox.write("taken/split.json", "{}");
    sandbox.fails("train scene --iterations 2 -m taken", &["taken", "split.json"]);
    sandbox.write("model/notes.txt", "mine");
    // A mistake elsewhere costs no model.
    sandbox.fails("train nowhere --iterations 2 -m model --overwrite", &["nowhere"]);
    sandbox.fails("train scene --iterations 2 -m model --overwrite --adapter nosuch", &["nosuch"]);
    sandbox.succeeds("train scene --iterations 2 -m model --overwrite");
    assert!(!sandbox.path("model/point_cloud/iteration_3").exists());
    assert!(sandbox.path("model/point_cloud/iteration_2/point_cloud.ply").is_file());
    assert_eq!(sandbox.text("model/notes.txt"), "mine");
}

#[test]
fn without_a_folder_name_the_next_free_one_is_taken() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.succeeds("train scene --iterations 1");
    sandbox.succeeds("train -s scene --iterations 1");
    for name in ["output/scene", "output/scene-2"] {
        assert!(sandbox.path(name).join("point_cloud/iteration_1/point_cloud.ply").is_file(), "{name}");
    }
    sandbox.fails("eval output/scene", &["no held-out views", "--eval"]);
}
