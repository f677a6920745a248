//! Walkers in training photos: which photos, what changes in them, masks, files.

use super::{assert_same, load, tiny};
use ibgs_data::dataset::Dataset;
use ibgs_demo::{DemoOptions, Walked, WalkerOptions, WalkerPixel};
use std::path::Path;

fn walked(percent: u32, cache: &Path) -> Walked {
    ibgs_demo::walkers(&WalkerOptions { scene: tiny(), percent }, Some(cache), &()).expect("the tiny scene loads")
}

fn rgba(dataset: &Dataset, view: usize) -> Vec<u8> {
    dataset.views[view].photo.pixels().unwrap().rgba.clone()
}

/// Views with a mask.
fn changed(walked: &Walked) -> Vec<usize> {
    (0..walked.masks.len()).filter(|&view| walked.masks[view].is_some()).collect()
}

#[test]
fn no_walkers_are_the_scene_itself() {
    let cache = tempfile::tempdir().expect("folder");
    let clean = load(&tiny(), cache.path());
    let none = walked(0, cache.path());
    assert_same(&clean, &none.dataset);
    assert_eq!(clean.path, none.dataset.path);
    assert_eq!(changed(&none), Vec::<usize>::new());
    assert_eq!(std::fs::read_dir(cache.path()).unwrap().count(), 1, "there is no folder but the scene's");
}

#[test]
fn the_percent_counts_and_all_else_stays() {
    let cache = tempfile::tempdir().expect("folder");
    let clean = load(&tiny(), cache.path());
    let mut fewer = Vec::new();
    // Eight photos train: 12.5 percent are one of them.
    for (percent, count) in [(5, 0), (13, 1), (50, 4), (100, 8)] {
        let mut walked = walked(percent, cache.path());
        let views = changed(&walked);
        assert_eq!(views.len(), count, "{percent} percent");
        assert!(views.iter().all(|view| clean.train.contains(view)), "{views:?}");
        assert!(fewer.iter().all(|view| views.contains(view)), "{fewer:?} stay in {views:?}");
        for view in 0..clean.views.len() {
            let is_same = rgba(&clean, view) == rgba(&walked.dataset, view);
            assert_eq!(is_same, !views.contains(&view), "view {view} at {percent} percent");
        }
        // All but the photos is the same.
        for view in &views {
            walked.dataset.views[*view].photo = clean.views[*view].photo.clone();
        }
        assert_same(&clean, &walked.dataset);
        fewer = views;
    }
}

#[test]
fn masks_say_which_pixels_differ() {
    let cache = tempfile::tempdir().expect("folder");
    let (clean, all) = (load(&tiny(), cache.path()), walked(100, cache.path()));
    for view in changed(&all) {
        let mask = all.masks[view].as_ref().expect("a mask");
        assert_eq!((mask.width, mask.height, mask.pixels.len()), (40, 30, 1_200));
        let (before, after) = (rgba(&clean, view), rgba(&all.dataset, view));
        let pixels = before.chunks_exact(4).zip(after.chunks_exact(4)).zip(&mask.pixels);
        let (mut figure, mut differ, mut shadow) = (0, 0, 0);
        for ((a, b), &pixel) in pixels {
            let most = (0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap_or(0);
            if pixel == WalkerPixel::Figure {
                figure += 1;
                differ += usize::from(most > 2);
            } else {
                assert_eq!(pixel == WalkerPixel::Shadow, most > 2, "view {view}");
                shadow += usize::from(pixel == WalkerPixel::Shadow);
            }
        }
        assert!(figure > 15 && figure < 400 && shadow > 10, "view {view}: {figure} and {shadow} pixels");
        assert!(differ * 10 > figure * 9, "view {view}: {differ} of {figure} pixels differ");
    }
}

#[test]
fn the_folder_is_a_scene_with_masks_and_is_read_back() {
    let cache = tempfile::tempdir().expect("folder");
    let first = walked(50, cache.path());
    assert!(first.dataset.notes.is_empty(), "{:?}", first.dataset.notes);
    let options = ibgs_data::dataset::LoadOptions { eval: true, ..Default::default() };
    let read = ibgs_data::dataset::load(&first.dataset.path, &options).expect("a scene folder");
    assert_eq!((&read.train, &read.test), (&first.dataset.train, &first.dataset.test));
    for view in 0..10 {
        assert!(rgba(&read, view) == rgba(&first.dataset, view), "photo {view}");
        let file = first.dataset.path.join("walkers").join(&first.dataset.views[view].name);
        let Some(mask) = &first.masks[view] else {
            assert!(!file.exists());
            continue;
        };
        let levels = image::open(&file).expect("a PNG file").into_luma8();
        assert_eq!(levels.dimensions(), (mask.width, mask.height));
        assert!(levels.iter().zip(&mask.pixels).all(|(&level, &pixel)| level == pixel as u8));
    }
    // A damaged photo and a lost mask are made again.
    let name = &first.dataset.views[changed(&first)[0]].name;
    std::fs::write(first.dataset.path.join("images").join(name), b"").expect("empty file");
    std::fs::remove_file(first.dataset.path.join("walkers").join(name)).expect("remove");
    let second = walked(50, cache.path());
    assert_same(&first.dataset, &second.dataset);
    assert_eq!(first.masks, second.masks);
    assert_eq!(second.dataset.notes.len(), 1, "{:?}", second.dataset.notes);
    assert!(first.dataset.path.join("walkers").join(name).is_file());
}

#[test]
fn exposures_change_held_out_photos_as_without_walkers() {
    let cache = tempfile::tempdir().expect("folder");
    let (mut clean, mut all) = (load(&tiny(), cache.path()), walked(100, cache.path()));
    let masks = std::mem::take(&mut all.masks);
    for dataset in [&mut clean, &mut all.dataset] {
        ibgs_demo::change_exposure(dataset, 1).expect("exposures");
    }
    for (view, mask) in masks.iter().enumerate() {
        let (a, b) = (rgba(&clean, view), rgba(&all.dataset, view));
        let Some(mask) = mask else {
            assert!(a == b, "held-out photo {view}");
            continue;
        };
        // A gain of 2^0.3 makes three levels of two.
        let pixels = a.chunks_exact(4).zip(b.chunks_exact(4)).zip(&mask.pixels);
        let mut same = pixels.filter(|(_, pixel)| **pixel == WalkerPixel::Same);
        assert!(same.all(|((a, b), _)| (0..3).all(|c| a[c].abs_diff(b[c]) <= 3)), "view {view}");
    }
}

#[test]
fn walkers_are_the_same_on_every_machine() {
    let cache = tempfile::tempdir().expect("folder");
    let all = walked(100, cache.path());
    let view = changed(&all)[0];
    let bytes: Vec<u8> = all.masks[view].iter().flat_map(|mask| &mask.pixels).map(|&pixel| pixel as u8).collect();
    let sums = [rgba(&all.dataset, view), bytes].map(|bytes| crc32fast::hash(&bytes));
    assert_eq!((view, sums), (1, [2_158_722_323, 848_436_523]));
    assert_eq!(crc32fast::hash(&rgba(&all.dataset, 0)), 893_407_438, "a photo without a walker");
}

#[test]
fn more_than_all_photos_are_refused() {
    let options = WalkerOptions { scene: DemoOptions::small(), percent: 101 };
    let error = ibgs_demo::walkers(&options, Some(Path::new("unused")), &()).err().expect("101 percent are too many");
    let text = error.to_string();
    assert!(text.contains("`walkers` is 101") && text.contains("0 to 100"), "{text}");
}
