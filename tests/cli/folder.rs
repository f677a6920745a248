//! The folder that a training writes to: one that is taken, replaced or free.

use super::Sandbox;
use std::fs;

#[test]
fn a_model_is_kept_unless_overwriting_is_asked_for() {
    let (sandbox, _) = Sandbox::with_model();
    sandbox.fails("train scene --iterations 2 -m model", &["model", "already holds a model trained for 3 iterations"]);
    sandbox.fails("train scene --iterations 2 -m scene/transforms.json", &["transforms.json", "another path"]);
    sandbox.write("taken/split.json", "{}");
    sandbox.fails("train scene --iterations 2 -m taken", &["taken", "split.json"]);
    sandbox.write("model/notes.txt", "mine");
    let of_the_old_model = [
        "result_training.json",
        "result_fps_mem.json",
        "results_renders.json",
        "results_mesh.json",
        "results_true_cameras.json",
        "results_fitted_poses.json",
        "training_log.json",
        "report.html",
    ];
    for name in of_the_old_model {
        sandbox.write(&format!("model/{name}"), r#"{"ours_3": {}}"#);
    }
    // A mistake elsewhere costs no model.
    sandbox.fails("train nowhere --iterations 2 -m model --overwrite", &["nowhere"]);
    sandbox.fails("train scene --iterations 2 -m model --overwrite --adapter nosuch", &["nosuch"]);
    // Masks around an object, which are known once the photos are read.
    mask_an_object(&sandbox);
    let moving = "train scene --iterations 2 -m model --overwrite --transients on";
    sandbox.fails(moving, &["transients.mask", "photos of an object"]);
    fs::remove_dir_all(sandbox.path("scene/masks")).unwrap();
    assert!(sandbox.path("model/point_cloud/iteration_3/point_cloud.ply").is_file());
    sandbox.succeeds("train scene --iterations 2 -m model --overwrite");
    assert!(!sandbox.path("model/point_cloud/iteration_3").exists());
    assert!(sandbox.path("model/point_cloud/iteration_2/point_cloud.ply").is_file());
    assert!(sandbox.path("model/point_cloud/iteration_2/residual_network.safetensors").is_file());
    for name in of_the_old_model.map(|name| sandbox.path("model").join(name)) {
        assert!(
            !fs::read_to_string(&name).is_ok_and(|text| text.contains("ours_3")),
            "{} is of the old model",
            name.display()
        );
    }
    assert_eq!(sandbox.text("model/notes.txt"), "mine");
}

/// Gives each photo a mask that leaves a disc, each another one.
fn mask_an_object(sandbox: &Sandbox) {
    fs::create_dir(sandbox.path("scene/masks")).unwrap();
    for (photo, number) in fs::read_dir(sandbox.path("scene/images")).unwrap().zip(0..) {
        let photo = photo.unwrap().path();
        let (width, height) = image::image_dimensions(&photo).unwrap();
        let (middle, radius) = (f64::from(height) / 2.0, f64::from(height) * (0.2 + 0.01 * f64::from(number)));
        let mask = image::GrayImage::from_fn(width, height, |x, y| {
            let is_kept = (f64::from(x) - f64::from(width) / 2.0).hypot(f64::from(y) - middle) < radius;
            image::Luma([if is_kept { 255 } else { 0 }])
        });
        mask.save(sandbox.path("scene/masks").join(photo.file_name().unwrap())).unwrap();
    }
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
