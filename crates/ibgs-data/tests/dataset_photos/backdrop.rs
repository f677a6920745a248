//! Photos of objects that were laid on one colour, without alpha.

use crate::dataset::{assert_note, load};
use ibgs_data::dataset::{self, ALPHA_EMPTY, Alpha, LoadOptions};
use ibgs_testing::scene_files::{Model, write_photo};
use std::path::Path;

/// A red square on black, 12 x 8.
fn write_object(path: &Path) {
    write_photo(path, 12, 8, |u, v| {
        let inside = (3.0..9.0).contains(&u) && (2.0..6.0).contains(&v);
        if inside { [200, 30, 30, 255] } else { [0, 0, 0, 255] }
    });
}

#[test]
fn one_colour_behind_all_photos_is_empty() {
    let folder = Model::small(9).scene();
    for i in 0..9 {
        write_object(&folder.path().join(format!("images/a{i}.png")));
    }
    let options = LoadOptions { eval: true, ..Default::default() };
    let dataset = load(folder.path(), &options);
    assert_eq!(dataset.backdrop, Some((Alpha::Keyed, [0; 3])));
    assert_note(&dataset, "photos of an object on one colour");
    let alpha = |view: usize, at: usize| dataset.views[view].photo.pixels().unwrap().rgba[4 * at + 3];
    let [test, train] = [dataset.test[0], dataset.train[0]];
    assert_eq!([alpha(train, 0), alpha(train, 4 * 12 + 6)], [ALPHA_EMPTY, 255]);
    assert_eq!([alpha(test, 0), alpha(test, 4 * 12 + 6)], [255; 2], "figures compare with the photo as it is");
    let plain = load(folder.path(), &LoadOptions { alpha: Some(Alpha::Mask), ..options.clone() });
    assert_eq!(plain.backdrop, None);
    // One photo of something else: a scene.
    write_photo(&folder.path().join("images/a4.png"), 12, 8, |u, v| [(20.0 * u) as u8, (30.0 * v) as u8, 9, 255]);
    assert_eq!(load(folder.path(), &options).backdrop, None);
    let keyed = LoadOptions { alpha: Some(Alpha::Keyed), ..options };
    let error = dataset::load(folder.path(), &keyed).unwrap_err().to_string();
    assert!(error.contains("do not lie on one colour") && error.contains("`data.alpha`"), "{error}");
}

#[test]
fn plain_pictures_show_no_object() {
    let folder = Model::small(3).scene();
    assert_eq!(load(folder.path(), &LoadOptions::default()).backdrop, None);
}
