//! `ibgs compare`: tables, pages and JSON of several models.

use super::report::{assert_self_contained, sources};
use super::{Sandbox, snapshot};
use ibgs_testing::scene_files::write_file;
use serde_json::{Value, json};

const KEY: &str = "ours_30";

/// The trained model in `model/`, the same once more in `other/` but a decibel better and on another device.
fn two_models() -> Sandbox {
    let (sandbox, _) = Sandbox::with_trained();
    let from = sandbox.path("model");
    for (path, content) in snapshot(&from) {
        if let Some(content) = content {
            write_file(&sandbox.path("other").join(path.strip_prefix(&from).unwrap()), content);
        }
    }
    edit(&sandbox, "other/results_renders_aggregate.json", |of| {
        of["PSNR"] = json!(of["PSNR"].as_f64().unwrap() + 1.0);
        of["protocol"]["device"] = json!("another <b>device</b>");
        of["protocol"]["resampler"] = json!("bicubic");
    });
    sandbox
}

/// Changes what a results file says of iteration 30.
fn edit(sandbox: &Sandbox, file: &str, change: impl FnOnce(&mut Value)) {
    let mut all = if sandbox.path(file).exists() { sandbox.json(file) } else { json!({ KEY: {} }) };
    change(&mut all[KEY]);
    sandbox.write(file, all.to_string());
}

#[test]
fn models_stand_beside_each_other() {
    let sandbox = two_models();
    let before = snapshot(sandbox.work.path());
    let outcome = sandbox.succeeds("compare model other");
    assert!(snapshot(sandbox.work.path()) == before, "comparing wrote something");
    for text in [
        "note: model has no speed and storage of iteration 30; run `ibgs eval model`",
        "differ in device",
        "differ in resampler",
    ] {
        assert!(outcome.stderr.contains(text), "`{text}` is missing\n{outcome}");
    }
    // No column is empty: nothing has measured LPIPS, frames or storage.
    let head = outcome.stdout.lines().next().unwrap().split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!(head, "model final PSNR SSIM base PSNR SSIM training", "{outcome}");
    assert!(!outcome.stderr.contains("resolution") && !outcome.stderr.contains("same views"), "{outcome}");

    let speed = |gaussians: u64, fps: f64| json!({ KEY: { "FPS_warm": fps, "FPS_cold": 1.0, "gaussians": gaussians, "storage_bytes": { "gaussians": 1_500_000, "photos": null } } });
    sandbox.write("model/result_fps_mem.json", speed(300, 20.0).to_string());
    sandbox.write("other/result_fps_mem.json", speed(200, 10.0).to_string());
    let outcome = sandbox.succeeds("compare model other -o page/c.html --json c.json");
    assert!(!outcome.stderr.contains("note: "), "{outcome}");
    let line = |start: &str| outcome.stdout.lines().find(|line| line.starts_with(start)).unwrap();
    let psnr =
        |model: &str| sandbox.json(&format!("{model}/results_renders_aggregate.json"))[KEY]["PSNR"].as_f64().unwrap();
    // The better PSNR and the fewer Gaussians, the more frames; equal values have no star.
    assert!(
        line("other").contains(&format!(" {:.3}* ", psnr("other"))) && line("other").contains(" 200* "),
        "{outcome}"
    );
    assert!(
        line("model ").trim().starts_with("model") && outcome.stdout.contains(&format!(" {:.3}  ", psnr("model"))),
        "{outcome}"
    );
    assert!(
        outcome.stdout.contains(" 20.0* ") && outcome.stdout.contains(" 1.50") && !outcome.stdout.contains("1.50*"),
        "{outcome}"
    );

    let json = sandbox.json("c.json");
    let models = json["models"].as_array().unwrap();
    assert!(models.len() == 2 && models[1]["figures"]["final_PSNR"].as_f64() == Some(psnr("other")), "{json}");
    assert!(models[0]["figures"]["storage_bytes"] == 1_500_000.0 && models[0]["figures"]["final_LPIPS"].is_null());
    assert_eq!(json["warnings"].as_array().unwrap().len(), 2, "{json}");

    let html = sandbox.text("page/c.html");
    let has_column = |title: &str| html.contains(&format!("<th scope=\"col\">{title}</th>"));
    assert!(has_column("FPS warm") && !has_column("LPIPS"), "a column without a value");
    assert_self_contained(&html);
    // Two views: the photo and a picture of each model.
    assert_eq!(sources(&html).len(), 2 * 3);
    assert!(html.contains("<h3>images/view_000.png</h3>") && html.contains("<h3>images/view_008.png</h3>"));
    assert!(html.contains(&format!("<td class=\"best\">{:.3}</td>", psnr("other"))));
    assert!(html.contains("another &lt;b&gt;device") && !html.contains("<b>device"));
}

#[test]
fn other_views_and_absent_pictures_are_told() {
    let sandbox = two_models();
    edit(&sandbox, "other/per_view_renders.json", |of| of["PSNR"] = json!({ "images/view_003.png": 20.0 }));
    let outcome = sandbox.succeeds("compare model other -o c.html");
    assert!(outcome.stderr.contains("not measured on the same views"), "{outcome}");
    let html = sandbox.text("c.html");
    assert!(html.contains("<h3>images/view_003.png</h3>"));
    assert_eq!(
        html.matches("no picture of this view").count(),
        3,
        "photo and both models of a view that nobody rendered"
    );
    // Iteration 7 has no residual.
    let outcome = sandbox.succeeds("compare model other --iteration 7");
    assert!(outcome.stderr.contains("speed and storage of iteration 7; run `ibgs eval model`"), "{outcome}");
    // No view was held out.
    let config = sandbox.text("model/config.toml");
    sandbox.write("model/config.toml", config.replace("eval = true", "eval = false"));
    let told = sandbox.succeeds("compare model other --iteration 7").stderr;
    assert!(told.contains("no views were held out: train with `--eval` to measure it"), "{told}");
}

#[test]
fn bad_input_is_named() {
    let sandbox = two_models();
    sandbox.fails("compare model nowhere", &["nowhere", "no trained model"]);
    sandbox.fails("compare model scene", &["scene", "no trained model"]);
    sandbox.fails("compare model model", &["model is named twice"]);
    sandbox.fails("compare model other --iteration 8", &["model has no iteration 8", "latest is 30"]);
    let arguments = "compare model";
    sandbox.fails_as(&mut sandbox.command(arguments), arguments, 2, &["2 values"]);
    let cases = [
        ("results_renders.json", "[]", "results_renders.json is damaged"),
        ("results_renders.json", r#"{"ours_30": {"PSNR": "many"}}"#, "`ours_30`"),
        ("per_view_renders.json", r#"{"ours_30": {"PSNR": [1]}}"#, "per_view_renders.json is damaged"),
        ("result_fps_mem.json", r#"{"ours_30": {"gaussians": -1}}"#, "result_fps_mem.json is damaged"),
        ("result_training.json", "{", "result_training.json is damaged"),
        ("training_log.json", "3", "training_log.json is damaged"),
    ];
    for (file, text, expected) in cases {
        let path = format!("other/{file}");
        let old = std::fs::read(sandbox.path(&path)).ok();
        sandbox.write(&path, text);
        sandbox.fails("compare model other -o c.html --json c.json", &[expected, "other"]);
        match old {
            Some(old) => sandbox.write(&path, old),
            None => std::fs::remove_file(sandbox.path(&path)).unwrap(),
        }
    }
    sandbox.fails("compare model other -o scene", &["cannot write scene"]);
    sandbox.write("other/test/ours_30/renders_aggregate/images/view_008.png", "no picture");
    sandbox.fails("compare model other -o c.html", &["view_008.png", "render it again"]);
}
