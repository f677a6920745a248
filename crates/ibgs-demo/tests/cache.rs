//! The demo scene's cache: round trip, damage, a folder that cannot be written.

use super::{assert_same, load, tiny};

#[test]
fn cache_round_trip_is_a_scene_folder() {
    let cache = tempfile::tempdir().expect("folder");
    let first = load(&tiny(), cache.path());
    assert!(first.notes.is_empty(), "{:?}", first.notes);
    let stamp = |name: &str| {
        let meta = std::fs::metadata(first.path.join(name)).expect("cached file");
        meta.modified().expect("time stamp")
    };
    let files = ["images/view_003.png", "transforms.json", "points3D.ply", "colmap/sparse/0/images.txt"];
    let before = files.map(stamp);
    let second = load(&tiny(), cache.path());
    assert_same(&first, &second);
    assert!(second.notes.is_empty(), "{:?}", second.notes);
    assert_eq!(before, files.map(stamp));

    let text = std::fs::read_to_string(first.path.join("transforms.json")).expect("transforms.json");
    let json: serde_json::Value = serde_json::from_str(&text).expect("valid JSON");
    assert_eq!(json["w"], 40);
    assert_eq!(json["frames"].as_array().map(Vec::len), Some(10));
    let frame = &json["frames"][4];
    assert_eq!(frame["file_path"], "images/view_004.png");
    let camera = &first.views[4].camera;
    let (back, eye) = (-camera.forward(), camera.center());
    for axis in 0..3 {
        let row = &frame["transform_matrix"][axis];
        let number = |column: usize| row[column].as_f64().expect("a number");
        assert!((number(2) - back[axis]).abs() < 1e-14 && (number(3) - eye[axis]).abs() < 1e-14);
    }
    assert!(frame["transform_matrix"][2][1].as_f64() > Some(0.0), "the image's up is the world's up");
}

#[test]
fn damaged_caches_are_traced_again() {
    let cache = tempfile::tempdir().expect("folder");
    let first = load(&tiny(), cache.path());
    let file = |name: &str| first.path.join("images").join(name);
    let whole = std::fs::read(file("view_001.png")).expect("photo");
    std::fs::write(file("view_001.png"), &whole[..whole.len() / 2]).expect("cut short");
    let mut flipped = std::fs::read(file("view_002.png")).expect("photo");
    let middle = flipped.len() / 2;
    flipped[middle] ^= 0x40;
    std::fs::write(file("view_002.png"), &flipped).expect("flip a bit");
    std::fs::write(file("view_003.png"), b"").expect("empty file");
    std::fs::remove_file(file("view_004.png")).expect("remove");
    std::fs::write(first.path.join("transforms.json"), "{").expect("cut short");
    let second = load(&tiny(), cache.path());
    assert_same(&first, &second);
    assert_eq!(second.notes.len(), 1, "{:?}", second.notes);
    assert!(second.notes[0].starts_with("3 cached photo(s)"), "{:?}", second.notes);
    assert_eq!(std::fs::read(file("view_001.png")).expect("photo"), whole);
    let third = load(&tiny(), cache.path());
    assert_same(&first, &third);
    assert!(third.notes.is_empty(), "{:?}", third.notes);
}

#[test]
fn unwritable_cache_leaves_one_note() {
    let folder = tempfile::tempdir().expect("folder");
    // A file where the folder should be fails for every user, the administrator included.
    let blocked = folder.path().join("occupied");
    std::fs::write(&blocked, "a file").expect("file");
    let set = load(&tiny(), &blocked);
    assert_eq!(set.views.len(), 10);
    assert_eq!(set.notes.len(), 1, "{:?}", set.notes);
    assert!(set.notes[0].contains("occupied") && set.notes[0].contains("writable"), "{:?}", set.notes);
}
