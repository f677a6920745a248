//! Bad camera lists of RealityCapture end in an error that names file, line and column.

use crate::dataset::reality_capture::HEADER;
use ibgs_data::dataset::{self, LoadOptions};
use ibgs_testing::fails;
use ibgs_testing::scene_files::{write_file, write_photo};

const ROW: &str = "a.png,1,2,3,4,5,6,20,0.01,0.02,0.1,0.2,0.3,0.4,0.5,0.6";

#[test]
fn camera_lists_that_make_no_sense() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path();
    for name in ["images/a.png", "images/b.png"] {
        write_photo(&scene.join(name), 12, 8, |_, _| [1, 2, 3, 255]);
    }
    let second = ROW.replace("a.png", "b.png").replace("0.1,0.2,0.3,0.4,0.5,0.6", "0,0,0,0,0,0");
    let good = format!("{HEADER}\n{second}\n{}\n", second.replace("b.png", "a.png"));
    let path = scene.join("cameras.csv");
    write_file(&path, &good);
    assert!(dataset::load(scene, &LoadOptions::default()).is_ok());
    let refused = |line: &str, fragments: &[&str]| {
        write_file(&path, format!("{HEADER}\n{second}\n{line}\n"));
        fails(scene, &[&["cameras.csv"], fragments].concat());
    };
    for (at, column) in HEADER.split(',').enumerate().skip(1) {
        let with = |value: &str| {
            let mut fields: Vec<&str> = ROW.split(',').collect();
            fields[at] = value;
            fields.join(",")
        };
        for value in ["NaN", "inf", "-1e999", "many", "0,5"] {
            let value = if value == "0,5" { "0;5" } else { value };
            refused(&with(value), &["line 3", &format!("{column} `{value}` is not a finite number")]);
        }
        refused(&with(""), &["line 3", &format!("{column} is missing")]);
        refused(&ROW.split(',').take(at).collect::<Vec<_>>().join(","), &["line 3", &format!("{column} is missing")]);
    }
    refused(&ROW.replace("a.png", ""), &["line 3", "the name is missing"]);
    refused(&ROW.replace("a.png", "../a.png"), &["../a.png", "`..`"]);
    refused(&ROW.replace("a.png", "b.png"), &["`b.png` is listed twice"]);
    refused(&ROW.replace(",20,", ",-20,"), &["line 3 (`a.png`)", "focal length"]);
    refused(&ROW.replace(",20,", ",1e30,"), &["line 3 (`a.png`)", "fits no image"]);
    refused(&ROW.replace(",1,2,", ",1e13,2,"), &["line 3", "lies beyond 1e12"]);
    write_file(&path, [good.as_bytes(), b"\xff,1\n"].concat());
    fails(scene, &["cameras.csv", "line 4", "UTF-8"]);
    write_file(&path, format!("{}\n{ROW}\n", HEADER.replace("alt,", "").replace("roll,", "")));
    fails(scene, &["cameras.csv", "line 1", "no column alt, roll", "Internal/External"]);
    write_file(&path, HEADER);
    fails(scene, &["cameras.csv", "lists no images"]);
    write_file(&path, &good);
    write_file(&scene.join("again.csv"), &good);
    fails(scene, &["several camera files: again.csv, cameras.csv"]);
    write_file(&scene.join("images/a.png"), "no photo");
    fails(&path, &["a.png does not decode"]);
}
