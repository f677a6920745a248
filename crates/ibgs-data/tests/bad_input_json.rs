//! Bad splits, options, `transforms.json` and PLY files end in an error that says what and where.

use ibgs_data::dataset::{self, LoadOptions, PrincipalPoint, Resolution};
use ibgs_testing::scene_files::{Model, write_file, write_photo};
use ibgs_testing::{fails, fails_with};
use std::fs;

#[test]
fn splits_that_do_not_fit() {
    let folder = Model::small(3).scene();
    let split = |text: &str, fragments: &[&str]| {
        write_file(&folder.path().join("split.json"), text);
        fails(folder.path(), fragments);
    };
    split("{", &["split.json", "line 1"]);
    split(r#"{"trian": []}"#, &["split.json", "trian"]);
    let absent = r#"{"train": ["a0.png", "x.png"], "test": []}"#;
    split(absent, &["split.json, train[1]", "no image `x.png`"]);
    let twice = r#"{"train": ["a0.png", "a1.png"], "test": ["a1.png"]}"#;
    split(twice, &["split.json, test[0]", "`a1.png` is listed twice"]);
    split(r#"{"train": ["a0.png"]}"#, &["1 training view,"]);
    fs::remove_file(folder.path().join("split.json")).unwrap();
    let every = |eval_split_every| LoadOptions { eval: true, eval_split_every, ..Default::default() };
    fails_with(folder.path(), &every(0), &["`data.eval-split-every`"]);
    fails_with(folder.path(), &every(1), &["0 training views"]);
}

#[test]
fn options_out_of_range() {
    for text in ["0", "3", "-2", "half", "99999999999"] {
        let error = text.parse::<Resolution>().unwrap_err().to_string();
        assert!(error.contains("`data.resolution`") && error.contains(text), "{error}");
    }
    let error = serde_json::from_str::<PrincipalPoint>("\"middle\"").unwrap_err().to_string();
    assert!(error.contains("middle") && error.contains("centred"), "{error}");
    let folder = Model::small(3).scene();
    let options = LoadOptions { max_resolution: Some(0), ..Default::default() };
    fails_with(folder.path(), &options, &["`data.max-resolution`"]);
}

#[test]
fn transforms_that_make_no_sense() {
    let folder = tempfile::tempdir().unwrap();
    for index in 0..2 {
        let path = folder.path().join(format!("images/{index}.png"));
        write_photo(&path, 8, 6, |_, _| [1, 2, 3, 255]);
    }
    let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";
    let good = format!(
        r#"{{"fl_x": 8, "frames": [{{"file_path": "images/0.png", "transform_matrix": {pose}}},
        {{"file_path": "images/1", "transform_matrix": {pose}}}]}}"#
    );
    let path = folder.path().join("transforms.json");
    write_file(&path, &good);
    assert!(dataset::load(folder.path(), &LoadOptions::default()).is_ok());
    let broken = |from: &str, to: &str, fragments: &[&str]| {
        assert!(good.contains(from));
        write_file(&path, good.replacen(from, to, 1));
        fails(folder.path(), fragments);
    };
    let mut at = ["transforms.json", "frames[0].transform_matrix", ""];
    at[2] = "not a rotation";
    broken("[1,0,0,0]", "[-1,0,0,0]", &at);
    broken("[1,0,0,0]", "[0,0,0,0]", &at);
    broken("[1,0,0,0]", "[2,0,0,0]", &at);
    at[2] = "4 x 4";
    broken("[1,0,0,0]", "[1,0,0]", &at);
    broken("[1,0,0,0]", "[NaN,0,0,0]", &["transforms.json", "line 1"]);
    broken("[1,0,0,0]", "[1,0,0,1e999]", &["transforms.json", "line 1"]);
    broken(r#""fl_x": 8, "#, "", &["frames[0] (`images/0.png`)", "fl_x"]);
    broken(r#""fl_x": 8"#, r#""fl_x": -8"#, &["frames[0]", "focal length"]);
    broken(r#""fl_x": 8"#, r#""fl_x": 8, "w": 0, "h": 3"#, &["frames[0]", "w = 0"]);
    let other = r#""camera_model": "EQUIRECTANGULAR", "fl_x": 8"#;
    broken(r#""fl_x": 8"#, other, &["frames[0]", "EQUIRECTANGULAR is not supported"]);
    broken(r#""fl_x": 8"#, r#""is_fisheye": 1, "fl_x": 8"#, &["transforms.json", "integer `1`"]);
    broken("images/0.png", "../0.png", &["../0.png", "`..`"]);
    broken("images/0.png", "images/1.png", &["`images/1.png` is listed twice"]);
    broken("images/0.png", "images/2.png", &["1 view,"]);
    broken("file_path", "file_paths", &["transforms.json", "file_path"]);
    let leaving = r#""ply_file_path": "/x.ply", "fl_x": 8"#;
    broken(r#""fl_x": 8"#, leaving, &["ply_file_path", "/x.ply"]);
    write_file(&path, r#"{"fl_x": 8, "frames": []}"#);
    fails(folder.path(), &["lists no images"]);
}

#[test]
fn ply_files_that_make_no_sense() {
    let mut model = Model::small(2);
    model.points.clear();
    let folder = model.scene();
    let header = |count: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n\
             end_header\n"
        )
    };
    let ply = |text: &str, fragments: &[&str]| {
        write_file(&folder.path().join("points3D.ply"), text);
        fails(folder.path(), &[&["points3D.ply"], fragments].concat());
    };
    ply("plx\n", &["first line"]);
    ply("ply\nformat ascii 1.0\n", &["end_header"]);
    ply(&header("many"), &["line 3", "`many`"]);
    ply(&(header("2") + "0 0 0\n"), &["claims 2 vertices, the file has 1"]);
    ply(&(header("1") + "0 zero 0\n"), &["line 8", "y `zero`"]);
    ply(&(header("1") + "0 0\n"), &["line 8", "2 values where 3"]);
    ply(&header("1").replace("float z", "float w"), &["property z is missing"]);
    let binary = header("18446744073709551615").replace("ascii", "binary_little_endian");
    ply(&(binary + "0123456789abc"), &["claims 18446744073709551615", "hold 1"]);
}
