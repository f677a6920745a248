//! Model folders and camera paths that cannot be used.

use super::Sandbox;
use serde_json::Value;
use std::fs;

const PLY: &str = "model/point_cloud/iteration_3/point_cloud.ply";

/// Every command that opens a model fails in the same way.
#[track_caller]
fn all_fail(sandbox: &Sandbox, fragments: &[&str]) {
    for command in [
        "render model",
        "render model --camera-path path.json -o frames",
        "eval model",
        "bench model",
        "export model -o model.ibgs",
        "export model -o model.ply",
    ] {
        sandbox.fails(command, fragments);
    }
}

/// A model folder, and a camera path that has no mistake.
fn model() -> Sandbox {
    let (sandbox, _) = Sandbox::with_model();
    sandbox.write("path.json", path_json("48", "50.0", "1.0"));
    sandbox
}

fn path_json(width: &str, fov: &str, first: &str) -> String {
    format!(
        r#"{{"camera_path":[{{"camera_to_world":[{first},0,0,0,0,1,0,0,0,0,1,2,0,0,0,1],"fov":{fov}}}],
        "render_width":{width},"render_height":36}}"#
    )
}

#[test]
fn folders_without_a_model() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.write("path.json", path_json("48", "50.0", "1.0"));
    let no_model = &["model", "holds no trained model"];
    all_fail(&sandbox, no_model);
    fs::create_dir(sandbox.path("model")).unwrap();
    all_fail(&sandbox, no_model);
    fs::create_dir_all(sandbox.path("model/point_cloud/iteration_30")).unwrap();
    all_fail(&sandbox, no_model);
    sandbox.fails("render scene", &["scene", "holds no trained model"]);
    sandbox.fails("info model", &["model", "holds no trained model"]);
    sandbox.fails("render scene/transforms.json", &["transforms.json"]);
}

#[test]
fn point_clouds_with_damage() {
    let sandbox = model();
    let whole = fs::read(sandbox.path(PLY)).unwrap();
    sandbox.write(PLY, &whole[..whole.len() - 100]);
    let fragments = &[PLY, "is truncated", "promises 300"];
    all_fail(&sandbox, fragments);
    sandbox.fails("info model", fragments);
    sandbox.fails(&format!("info {PLY}"), fragments);

    let mut damaged = whole.clone();
    let last = damaged.len() - 4;
    damaged[last..].copy_from_slice(&f32::NAN.to_le_bytes());
    sandbox.write(PLY, damaged);
    let info = sandbox.succeeds(&format!("info {PLY}"));
    assert!(info.stderr.contains("1 of 300 Gaussians have values that are not finite"), "{info}");
    assert!(info.stdout.contains("299 Gaussians"), "{info}");
    sandbox.succeeds("render model --outputs base");
    damaged = whole.clone();
    let first = damaged.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    damaged[first..].chunks_exact_mut(4).for_each(|value| value.copy_from_slice(&f32::NAN.to_le_bytes()));
    sandbox.write(PLY, damaged);
    let fragments = &[PLY, "`x` of Gaussian 0", "not a finite number"];
    all_fail(&sandbox, fragments);
    sandbox.fails(&format!("info {PLY}"), fragments);

    sandbox.write(PLY, whole);
    sandbox.fails("render model --iteration 77", &["iteration_77"]);
    sandbox.fails("eval model --iteration 77", &["iteration_77"]);
    sandbox.fails("info model/input.ply", &["input.ply", "is this a plain point cloud?"]);
}

#[test]
fn other_files_with_damage() {
    let sandbox = model();
    let config = sandbox.text("model/config.toml");
    sandbox.write("model/config.toml", format!("colour = 3\n{config}"));
    all_fail(&sandbox, &["config.toml, line 1", "`colour`"]);
    fs::remove_file(sandbox.path("model/config.toml")).unwrap();
    // Other programs' models have no such file: they render, but nothing says which photos they belong to.
    sandbox.succeeds("render model");
    sandbox.fails("eval model", &["config.toml", "--source"]);
    sandbox.write("model/config.toml", config);
    let cameras = sandbox.text("model/cameras.json");
    let views = ["render model", "eval model", "bench model", "info model"];
    for (text, fragment) in [(&cameras[..cameras.len() / 2], "line"), ("{}", "line")] {
        sandbox.write("model/cameras.json", text);
        for command in views {
            sandbox.fails(command, &["cameras", fragment]);
        }
    }
    sandbox.write("model/cameras.json", "[]");
    sandbox.fails("render model", &["no such view"]);
    sandbox.fails("eval model", &["no held-out views"]);
    sandbox.fails("bench model", &["no cameras"]);
    fs::remove_file(sandbox.path("model/cameras.json")).unwrap();
    for command in views {
        sandbox.fails(command, &["cameras.json"]);
    }
    sandbox.write("model/cameras.json", cameras.replace("view_003.png", "view_999.png"));
    sandbox.fails("eval model", &["view_999.png"]);
    sandbox.write("model/cameras.json", cameras);
    fs::remove_dir_all(sandbox.path("scene")).unwrap();
    sandbox.fails("eval model", &["scene"]);
}

/// `scene/` once more under another name, its list of photos changed.
fn copied(sandbox: &Sandbox, name: &str, rename: impl Fn(&str) -> String, change: impl Fn(&mut Value)) {
    let (from, to) = (sandbox.path("scene"), sandbox.path(name));
    for entry in fs::read_dir(from.join("images")).unwrap().map(|entry| entry.unwrap()) {
        let photo = to.join("images").join(rename(entry.file_name().to_str().unwrap()));
        fs::create_dir_all(photo.parent().unwrap()).unwrap();
        fs::copy(entry.path(), photo).unwrap();
    }
    let mut list: Value = serde_json::from_str(&rename(&sandbox.text("scene/transforms.json"))).unwrap();
    list.as_object_mut().unwrap().remove("ply_file_path");
    change(&mut list);
    sandbox.write(&format!("{name}/transforms.json"), list.to_string());
}

/// The names and places of a scene's cameras are compared with those of the model, whichever program wrote it.
#[test]
fn sources_that_are_another_scene() {
    let sandbox = model();
    let same = |text: &str| text.to_owned();
    copied(&sandbox, "other", |text| text.replace("view_", "shot_"), |_| ());
    copied(&sandbox, "turned", same, |list| {
        for frame in list["frames"].as_array_mut().unwrap() {
            let rows = frame["transform_matrix"].as_array_mut().unwrap();
            for value in rows[1..3].iter_mut().flat_map(|row| row.as_array_mut().unwrap()) {
                *value = (-value.as_f64().unwrap()).into();
            }
        }
    });
    copied(&sandbox, "moved", same, |_| ());
    for own in [true, false] {
        if !own {
            fs::remove_file(sandbox.path("model/config.toml")).unwrap();
        }
        sandbox.fails("eval model --source other", &["other is not the scene", "of the 10 photos", "`--source`"]);
        sandbox.fails("eval model --source turned", &["turned is not the scene", "stand elsewhere", "`--source`"]);
        let outcome = sandbox.succeeds("eval model --source moved");
        assert!(!outcome.stdout.contains("NaN") && !outcome.stdout.contains("glossy"), "{outcome}");
    }
    let cameras: Vec<Value> = serde_json::from_str(&sandbox.text("model/cameras.json")).unwrap();
    // Names as 3DGS keeps them, of photos in another folder.
    let stems = cameras.iter().cloned().map(|mut camera| {
        camera["img_name"] =
            camera["img_name"].as_str().unwrap().rsplit('/').next().unwrap().replace(".png", "").into();
        camera.as_object_mut().unwrap().remove("split");
        camera
    });
    sandbox.write("model/cameras.json", format!("\u{feff}{}", Value::from_iter(stems)));
    sandbox.succeeds("eval model --source moved");
    sandbox.fails("eval model --source other", &["other is not the scene", "10 of the 10 photos"]);
    sandbox.write("model/cameras.json", Value::from_iter(cameras.into_iter().take(7)).to_string());
    let outcome = sandbox.succeeds("eval model --source moved");
    assert!(outcome.stderr.contains("does not list 3 of the 10 photos"), "{outcome}");
}

#[test]
fn camera_paths_with_mistakes() {
    let sandbox = model();
    sandbox.succeeds("render model --camera-path path.json -o frames");
    sandbox.fails("render model --camera-path nowhere.json", &["nowhere.json"]);
    let cases = [
        (path_json("0", "50", "1"), "`render_width` is 0"),
        (path_json("99999", "50", "1"), "`render_width` is 99999"),
        (path_json("48", "0", "1"), "camera_path[0]: `fov` is 0"),
        (path_json("48", "180", "1"), "`fov` is 180"),
        (path_json("48", "50", "0"), "`camera_to_world` is no rotation"),
        (path_json("48", "50", "1e999"), "line 1"),
        (path_json("48", "null", "1"), "camera_path[0]: `fov` must be a number"),
        (path_json("48", "50", "\"one\""), "camera_path[0]: `camera_to_world` must be 16 numbers"),
        (path_json("48", "50", "1, 1"), "camera_path[0]: `camera_to_world` must be 16 numbers"),
        (path_json("48", "50", "1").replacen('{', r#"{"fps":0,"#, 1), "`fps` is 0"),
        (r#"{"camera_path":[],"render_width":48,"render_height":36}"#.to_owned(), "`camera_path` is empty"),
        (r#"{"render_width":48,"render_height":36}"#.to_owned(), "camera_path"),
        ("not json".to_owned(), "line 1"),
    ];
    for (text, fragment) in cases {
        sandbox.write("bad.json", text);
        sandbox.fails("render model --camera-path bad.json -o other", &["bad.json", fragment]);
    }
}
