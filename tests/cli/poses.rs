//! Trainings that refine the cameras.

use super::Sandbox;
use glam::{DMat4, DQuat, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::output::OutputFolder;
use ibgs_core::output::cameras::Split;
use serde_json::json;

fn cameras(sandbox: &Sandbox, model: &str, split: Split) -> Vec<Camera> {
    let records = OutputFolder::open(&sandbox.path(model)).unwrap().read_cameras().unwrap();
    records.into_iter().filter(|record| record.split == Some(split)).map(|record| record.camera).collect()
}

/// The model folder has the refined cameras, and everything that opens it sees through them.
#[test]
fn a_model_is_seen_through_its_refined_cameras() {
    let (sandbox, _) = Sandbox::with_scene();
    let text = "[surface]\nstart = 4\n[residual]\nstart = 8\nfactor = 0.25\n[poses]\nfrom = 2\n";
    sandbox.write("run.toml", text);
    let line = "train scene --config run.toml --eval --iterations 20 --exposure on";
    sandbox.succeeds(&format!("{line} -m given"));
    let outcome = sandbox.succeeds(&format!("{line} -m refined --refine-poses on"));
    assert!(outcome.stderr.contains("cameras: refined by 0."), "{outcome}");
    let [given, refined] = ["given", "refined"].map(|model| cameras(&sandbox, model, Split::Train));
    assert!(given.iter().zip(&refined).all(|(given, refined)| !given.has_pose_of(refined)), "all have learned");
    let [given, moved] = ["given", "refined"].map(|model| cameras(&sandbox, model, Split::Test));
    let most = given.iter().zip(&moved).map(|(a, b)| a.center().distance(b.center())).fold(0.0, f64::max);
    assert!(most > 0.0 && most < 0.1, "held-out cameras move with the frame alone: {most}");

    let key = "ours_20";
    let psnr = || {
        let scores = sandbox.json("refined/results_renders_aggregate.json");
        scores[key]["PSNR"].as_f64().unwrap()
    };
    let trained = psnr();
    let fitted =
        || sandbox.json("refined/results_fitted_poses.json")[key]["final"]["PSNR_fitted_pose"].as_f64().unwrap();
    assert!(fitted() >= trained, "{} from poses that are fitted to the photos", fitted());
    std::fs::remove_file(sandbox.path("refined/results_fitted_poses.json")).unwrap();
    assert!(sandbox.succeeds("eval refined --fit-poses").stdout.contains("PSNR_fitted_pose"));
    assert!(fitted() >= psnr());
    assert!((psnr() - trained).abs() < 0.02, "{trained} in training, {} by `eval`", psnr());
    sandbox.succeeds("export refined -o refined.ibgs");
    sandbox.succeeds("export refined --cameras sparse");
    let first = refined[0].translation;
    assert!(sandbox.text("sparse/images.txt").contains(&format!(" {} {} {} ", first.x, first.y, first.z)));
    assert!(sandbox.succeeds("info refined").stdout.contains("poses.refine = \"on\""));
}

/// A copy of the scene with other camera-to-world matrices, by number and as they are, and without the last photos.
fn copy_scene(sandbox: &Sandbox, name: &str, without: usize, change: impl Fn(usize, DMat4) -> DMat4) {
    let mut listing = sandbox.json("scene/transforms.json");
    let frames = listing["frames"].as_array_mut().unwrap();
    frames.truncate(frames.len() - without);
    for (number, frame) in frames.iter_mut().enumerate() {
        let rows: [[f64; 4]; 4] = serde_json::from_value(frame["transform_matrix"].take()).unwrap();
        let changed = change(number, DMat4::from_cols_array_2d(&rows).transpose());
        frame["transform_matrix"] = json!(changed.transpose().to_cols_array_2d());
        let file = frame["file_path"].as_str().unwrap();
        let photo = std::fs::read(sandbox.path("scene").join(file)).unwrap();
        ibgs_testing::scene_files::write_file(&sandbox.path(name).join(file), &photo);
    }
    listing.as_object_mut().unwrap().remove("ply_file_path");
    sandbox.write(&format!("{name}/transforms.json"), listing.to_string());
}

#[test]
fn held_out_views_are_also_measured_at_the_places_of_another_scene() {
    let (sandbox, _) = Sandbox::with_model();
    let (scale, turn) = (1.7, DQuat::from_rotation_x(0.4) * DQuat::from_rotation_z(2.5));
    // The scene in another frame and unit; held-out photos, every eighth, may be turned about their own axis.
    let moved = |number: usize, angle: f64, matrix: DMat4| {
        let (_, rotation, place) = matrix.to_scale_rotation_translation();
        let own = DQuat::from_rotation_z(if number.is_multiple_of(8) { angle } else { 0.0 });
        let place = scale * (turn * place) + DVec3::new(3.0, -1.0, 0.5);
        DMat4::from_rotation_translation(turn * rotation * own, place)
    };
    copy_scene(&sandbox, "same", 0, |number, matrix| moved(number, 0.0, matrix));
    copy_scene(&sandbox, "turned", 0, |number, matrix| moved(number, 0.7, matrix));
    copy_scene(&sandbox, "less", 2, |_, matrix| matrix);
    let missing = "less has no cameras of 2 of the model's 10 photos: images/view_009.png, images/view_008.png";
    sandbox.fails("eval model --true-cameras less", &["`--true-cameras`", missing]);
    sandbox.fails("eval model --true-cameras nowhere", &["nowhere"]);

    let mut there = Vec::new();
    for scene in ["same", "turned"] {
        let outcome = sandbox.succeeds(&format!("eval model --true-cameras {scene}"));
        let said = format!("PSNR_true_cameras, held-out views where {scene} has their cameras: base ");
        let right =
            "training cameras miss theirs by 0.000 degrees, 0.000 % of their distance and 0.000 % of the focal length";
        assert!(outcome.stdout.contains(&said) && outcome.stdout.contains(right), "{outcome}");
        let scores = &sandbox.json("model/results_true_cameras.json")["ours_3"];
        assert_eq!(scores["views"], 2);
        there.push(scores["base"]["PSNR_true_cameras"].as_f64().unwrap());
    }
    let given = sandbox.json("model/results_renders.json")["ours_3"]["PSNR"].as_f64().unwrap();
    assert!((there[0] - given).abs() < 0.01 && (there[1] - given).abs() > 0.1, "{there:?} and {given}");
}
