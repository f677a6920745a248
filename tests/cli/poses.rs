//! Trainings that refine the cameras.

use super::Sandbox;
use ibgs_core::camera::Camera;
use ibgs_core::output::OutputFolder;
use ibgs_core::output::cameras::Split;

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
