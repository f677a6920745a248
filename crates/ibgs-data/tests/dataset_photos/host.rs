//! Photos that the host does not keep decoded.

use crate::dataset::load;
use ibgs_data::dataset::{Dataset, LoadOptions};
use ibgs_data::memory::MemoryBudget;
use ibgs_testing::scene_files::{Model, write_file, write_photo, zip_of_folder};
use std::fs;
use std::path::Path;

/// Bytes of a decoded photo of the small scene.
const PHOTO: u64 = 12 * 8 * 4;

/// A scene of five photos, each of its own colour.
fn scene() -> tempfile::TempDir {
    let folder = Model::small(5).scene();
    for index in 0..5_u8 {
        let path = folder.path().join(format!("images/a{index}.png"));
        write_photo(&path, 12, 8, |x, y| [40 * index, 10 * x as u8, 20 * y as u8, 255]);
    }
    folder
}

fn within(path: &Path, bytes: Option<u64>) -> Dataset {
    let host_memory = bytes.map_or(MemoryBudget::Unlimited, MemoryBudget::Bytes);
    load(path, &LoadOptions { host_memory, ..LoadOptions::default() })
}

fn pixels(dataset: &Dataset) -> Vec<Vec<u8>> {
    dataset.views.iter().map(|view| view.photo.pixels().unwrap().rgba.clone()).collect()
}

#[test]
fn photos_are_the_same_whatever_the_memory() {
    let folder = scene();
    let all = within(folder.path(), None);
    let expected = pixels(&all);
    assert!(all.views.iter().all(|view| view.photo.is_kept()) && expected[0] != expected[1]);
    let archive = folder.path().join("scene.zip");
    write_file(&archive, zip_of_folder(folder.path(), ""));
    for bytes in [0, PHOTO, 2 * PHOTO + 1, 5 * PHOTO] {
        for path in [folder.path(), &archive] {
            let some = within(path, Some(bytes));
            assert_eq!(some.checksum(), all.checksum(), "{bytes}");
            assert!(some.views.iter().all(|view| view.photo.is_kept() == (bytes >= 5 * PHOTO)), "{bytes}");
            for _ in 0..2 {
                some.views.iter().rev().for_each(|view| view.photo.decode_ahead());
                assert!(pixels(&some) == expected, "{bytes}");
            }
        }
    }
}

#[test]
fn a_photo_that_is_used_stays() {
    let folder = scene();
    let dataset = within(folder.path(), Some(2 * PHOTO));
    let photo = |index: usize| dataset.views[index].photo.pixels();
    photo(0).unwrap();
    photo(1).unwrap();
    photo(0).unwrap();
    photo(2).unwrap();
    // Of the last two nothing is read again.
    fs::remove_dir_all(folder.path().join("images")).unwrap();
    photo(0).unwrap();
    photo(2).unwrap();
    let error = photo(1).unwrap_err().to_string();
    assert!(error.contains("a1.png"), "{error}");
    // Another try fails alike.
    assert_eq!(photo(1).unwrap_err().to_string(), error);
}

#[test]
fn a_photo_that_has_changed_is_refused() {
    let folder = scene();
    let dataset = within(folder.path(), Some(0));
    write_photo(&folder.path().join("images/a3.png"), 12, 8, |_, _| [1, 2, 3, 255]);
    let error = dataset.views[3].photo.pixels().unwrap_err().to_string();
    assert!(error.contains("a3.png has changed"), "{error}");
    write_photo(&folder.path().join("images/a3.png"), 6, 4, |_, _| [1, 2, 3, 255]);
    assert!(dataset.views[3].photo.pixels().is_err());
    assert!(dataset.views[2].photo.pixels().is_ok());
}

/// Many threads at once, those of the pool too.
#[test]
fn threads_share_what_is_decoded() {
    use rayon::prelude::*;
    let folder = scene();
    let expected = pixels(&within(folder.path(), None));
    let dataset = within(folder.path(), Some(2 * PHOTO));
    let check = |turn: usize| {
        let view = (7 * turn) % 5;
        dataset.views[(view + 1) % 5].photo.decode_ahead();
        assert!(dataset.views[view].photo.pixels().unwrap().rgba == expected[view]);
    };
    std::thread::scope(|scope| {
        for first in 0..4 {
            scope.spawn(move || (first..first + 50).for_each(check));
        }
        (0..200_usize).into_par_iter().for_each(check);
    });
}
