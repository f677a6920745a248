//! Masks as other programs name them, beside the photos too, and masks that do not fit.

use super::{assert_note, load_plain, transforms};
use ibgs_data::dataset::{self, Dataset};
use ibgs_testing::fails;
use ibgs_testing::scene_files::{Model, write_file, write_photo};
use std::path::Path;

/// A mask that drops the left quarter of a photo.
fn mask(path: &Path) {
    write_photo(path, 12, 8, |u, _| if u < 3.0 { [0, 0, 0, 255] } else { [255; 4] });
}

/// Whether each view is masked.
fn masked(dataset: &Dataset) -> Vec<bool> {
    dataset.views.iter().map(|view| view.photo.pixels().unwrap().rgba[3] < 128).collect()
}

#[test]
fn masks_as_other_programs_name_them() {
    let names = [
        "masks/a1.png",
        "masks/a1.png.png",
        "masks/a1.png.mask.png",
        "masks/a1.mask.jpg",
        "masks/a1_mask.png",
        "images/a1.png.mask.png",
        "images/a1.mask.png",
        "images/a1_mask.png",
        "images/a1.png_mask.png",
    ];
    for name in names {
        let folder = Model::small(3).scene();
        mask(&folder.path().join(name));
        let dataset = load_plain(folder.path());
        assert_eq!(masked(&dataset), [false, true, false], "{name}");
        assert_eq!(dataset.notes, ["1 photo masked"], "{name}");
        let info = dataset::inspect(folder.path()).unwrap();
        assert_eq!((info.masks, info.unposed.len(), info.notes.len()), (1, 0, 0), "{name}");
    }
    // Frames of a transforms.json, whose names begin with the photo folder.
    let folder = Model::small(2).scene();
    std::fs::remove_dir_all(folder.path().join("sparse")).unwrap();
    let frames = transforms(r#""fl_x": 9,"#, &[("images/a0.png", ""), ("images/a1", "")]);
    write_file(&folder.path().join("transforms.json"), frames);
    mask(&folder.path().join("masks/a0_mask.png"));
    mask(&folder.path().join("images/a1.png.mask.png"));
    let dataset = load_plain(folder.path());
    assert_eq!(masked(&dataset), [true, true]);
    assert!(!dataset.notes.iter().any(|note| note.contains("no pose")), "{:?}", dataset.notes);
}

#[test]
fn masks_of_no_photo_are_named() {
    let folder = Model::small(2).scene();
    mask(&folder.path().join("masks/a0_mask.png"));
    let expected = "2 of 3 files in masks belong to no photo with a pose and are not used: masks/a0-mask.png, \
                    masks/sub/b.png; a mask of a.jpg is named a.png, a.mask.png or a_mask.png";
    mask(&folder.path().join("masks/a0-mask.png"));
    mask(&folder.path().join("masks/sub/b.png"));
    assert_note(&load_plain(folder.path()), expected);
    let info = dataset::inspect(folder.path()).unwrap();
    assert_eq!(info.masks, 1);
    assert!(info.notes.len() == 1 && info.notes[0].contains(expected), "{:?}", info.notes);
    // A photo whose name ends as a mask's does, without the photo that it would be the mask of.
    mask(&folder.path().join("images/c_mask.png"));
    assert_eq!(dataset::inspect(folder.path()).unwrap().unposed, ["images/c_mask.png"]);
}

#[test]
fn a_mask_of_another_shape_is_refused_and_one_of_another_size_is_not() {
    let folder = Model::small(2).scene();
    let path = folder.path().join("masks/a1_mask.png");
    write_photo(&path, 6, 4, |u, _| if u < 2.0 { [0, 0, 0, 255] } else { [255; 4] });
    assert_eq!(masked(&load_plain(folder.path())), [false, true]);
    assert_eq!(dataset::inspect(folder.path()).unwrap().refused, None);
    write_photo(&path, 8, 12, |_, _| [255; 4]);
    let sentence = "has 8 x 12 pixels, another shape than the 12 x 8 of its photo";
    fails(folder.path(), &["masks", "a1_mask.png", sentence, "a1.png; make the mask from this photo"]);
    let refused = dataset::inspect(folder.path()).unwrap().refused.unwrap();
    assert!(refused.contains(sentence), "{refused}");
}
