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
        "training_log.json",
        "report.html",
    ];
    for name in of_the_old_model {
        sandbox.write(&format!("model/{name}"), r#"{"ours_3": {}}"#);
    }
    // A mistake elsewhere costs no model.
    sandbox.fails("train nowhere --iterations 2 -m model --overwrite", &["nowhere"]);
    sandbox.fails("train scene --iterations 2 -m model --overwrite --adapter nosuch", &["nosuch"]);
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
