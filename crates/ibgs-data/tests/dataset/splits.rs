//! The split of Blender's files, whichever of them there are.

use super::{assert_note, load, load_plain, transforms};
use ibgs_data::dataset::{self, LoadOptions};
use ibgs_testing::scene_files::{write_file, write_photo};
use std::path::Path;

/// A scene of these parts, each with photos of its own.
fn write(scene: &Path, parts: &[(&str, usize)]) {
    for (part, count) in parts {
        let names: Vec<String> = (0..*count).map(|index| format!("./{part}/r_{index}")).collect();
        for name in &names {
            write_photo(&scene.join(format!("{name}.png")), 10, 10, |_, _| [5, 6, 7, 255]);
        }
        let frames: Vec<(&str, &str)> = names.iter().map(|name| (name.as_str(), "")).collect();
        let json = transforms(r#""camera_angle_x": 0.7,"#, &frames);
        write_file(&scene.join(format!("transforms_{part}.json")), json);
    }
}

#[test]
fn what_is_held_out_follows_the_files_that_are_there() {
    let eval = LoadOptions { eval: true, ..LoadOptions::default() };
    // Parts, views held out, how many train without `eval`, what decides.
    type Case = (&'static [(&'static str, usize)], &'static [&'static str], usize, &'static str);
    let cases: [Case; 4] = [
        (&[("train", 9)], &["train/r_0.png", "train/r_8.png"], 9, "every 8th photo by name"),
        (&[("train", 3), ("val", 2)], &["val/r_0.png", "val/r_1.png"], 5, "transforms_val.json"),
        (&[("train", 3), ("test", 1)], &["test/r_0.png"], 4, "transforms_test.json"),
        (&[("train", 3), ("test", 1), ("val", 2)], &["test/r_0.png"], 4, "transforms_test.json"),
    ];
    for (parts, test, all, by) in cases {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), parts);
        let dataset = load(folder.path(), &eval);
        let names = |views: &[usize]| views.iter().map(|&view| dataset.views[view].name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&dataset.test), test, "{parts:?}");
        assert_eq!(dataset.train.len(), all - test.len(), "{parts:?}");
        assert_eq!(load_plain(folder.path()).train.len(), all, "{parts:?}");
        let info = dataset::inspect(folder.path()).unwrap();
        assert_eq!((info.split.train, info.split.test, info.split.by.as_str()), (all - test.len(), test.len(), by));
        let note = "transforms_val.json is not used: transforms_test.json lists the views to hold out";
        assert_eq!(info.notes.iter().any(|told| told == note), parts.len() == 3, "{:?}", info.notes);
        if parts.len() == 3 {
            assert_note(&dataset, note);
        }
    }
}
