//! `train_filenames`, `val_filenames` and `test_filenames` of a `transforms.json`.

use super::{assert_note, load, load_plain, transforms};
use ibgs_data::dataset::{self, LoadOptions};
use ibgs_testing::fails_with;
use ibgs_testing::scene_files::{write_file, write_photo};
use std::path::Path;

/// Six frames with these fields beside them; the last photo is absent.
fn write(scene: &Path, fields: &str) {
    let names: Vec<String> = (0..6).map(|index| format!("images/{index}.png")).collect();
    for name in &names[..5] {
        write_photo(&scene.join(name), 8, 6, |_, _| [1, 2, 3, 255]);
    }
    let frames: Vec<(&str, &str)> = names.iter().map(|name| (name.as_str(), "")).collect();
    write_file(&scene.join("transforms.json"), transforms(&format!(r#""fl_x": 8, {fields}"#), &frames));
}

#[test]
fn lists_are_the_split() {
    let folder = tempfile::tempdir().unwrap();
    let eval = LoadOptions { eval: true, ..LoadOptions::default() };
    let split = |fields: &str, train: &[usize], test: &[usize]| {
        write(folder.path(), fields);
        let dataset = load(folder.path(), &eval);
        assert_eq!((&dataset.train[..], &dataset.test[..]), (train, test), "{fields}");
        let info = dataset::inspect(folder.path()).unwrap().split;
        assert_eq!((info.train, info.test), (train.len(), test.len()), "{fields}");
        // Without `--eval` everything trains.
        assert_eq!(load_plain(folder.path()).train.len(), 5);
        (dataset, info.by)
    };
    split("", &[1, 2, 3, 4], &[0]);
    let all = r#""train_filenames": ["images/0.png", "./images/1.png", "images\\2.png", "images/5.png"],"#;
    let (dataset, by) = split(&format!(r#"{all} "test_filenames": ["images/3.png"],"#), &[0, 1, 2], &[3]);
    assert_eq!(by, "test_filenames");
    assert_note(&dataset, "test_filenames: 1 photo neither for training nor held out");
    split(&format!(r#"{all} "val_filenames": ["images/3.png"], "test_filenames": [],"#), &[0, 1, 2], &[3]);
    split(all, &[0, 1, 2], &[3, 4]);
    let test = r#""test_filenames": ["images/0.png", "images/5.png"],"#;
    split(test, &[1, 2, 3, 4], &[0]);
    split(&format!(r#"{test} "val_filenames": ["images/1.png"],"#), &[2, 3, 4], &[0]);
    split(&format!(r#"{test} "val_filenames": ["images/0.png", "images/5.png"],"#), &[1, 2, 3, 4], &[0]);
    write_file(&folder.path().join("split.json"), r#"{"train": ["images/0.png", "images/1.png"]}"#);
    assert_eq!(load(folder.path(), &eval).train, [0, 1]);
}

#[test]
fn lists_that_contradict() {
    let folder = tempfile::tempdir().unwrap();
    let eval = LoadOptions { eval: true, ..LoadOptions::default() };
    let refused = |fields: &str, fragments: &[&str]| {
        write(folder.path(), fields);
        fails_with(folder.path(), &eval, &[&["transforms.json"], fragments].concat());
        assert!(dataset::inspect(folder.path()).is_err());
    };
    let two = r#""train_filenames": ["images/0.png", "images/1.png"],"#;
    let both = format!(r#"{two} "test_filenames": ["images/2.png", "images/1.png"],"#);
    refused(&both, &["test_filenames", "`images/1.png` is in train_filenames too"]);
    let both = format!(r#"{two} "val_filenames": ["images/0.png"],"#);
    refused(&both, &["val_filenames", "`images/0.png` is in train_filenames too"]);
    let twice = r#""test_filenames": ["images/1.png", "./images/1.png"],"#;
    refused(twice, &["test_filenames[1]", "`./images/1.png` is listed twice"]);
    let unknown = r#""train_filenames": ["images/0.png", "images/9.png"],"#;
    refused(unknown, &["train_filenames[1]", "no frame has the file_path `images/9.png`", "look like `images/0.png`"]);
    refused(r#""train_filenames": "images/0.png","#, &["line 1", "sequence"]);
    refused(r#""train_filenames": [7],"#, &["line 1", "integer `7`"]);
    write(folder.path(), r#""train_filenames": ["images/0.png"],"#);
    fails_with(folder.path(), &eval, &["1 training view,"]);
}
