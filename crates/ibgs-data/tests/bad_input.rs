//! Damaged and contradictory scenes end in an error that says what and where, never in a panic.

use ibgs_data::dataset::{self, LoadOptions};
use ibgs_testing::scene_files::{Model, write_file, write_photo};
use ibgs_testing::{fails, fails_with};
use std::fs;

/// The small model after a change.
#[track_caller]
fn changed_fails(change: impl Fn(&mut Model), fragments: &[&str]) {
    let mut model = Model::small(3);
    change(&mut model);
    // Names that leave the folder must not be written to.
    let folder = Model::small(3).scene();
    model.write_binary(folder.path());
    fails(folder.path(), fragments);
    fs::remove_dir_all(folder.path().join("sparse")).unwrap();
    model.write_text(folder.path());
    fails(folder.path(), fragments);
}

#[test]
fn folders_that_are_no_scene() {
    let folder = tempfile::tempdir().unwrap();
    fails(&folder.path().join("absent"), &["cannot read", "absent"]);
    fails(folder.path(), &["is not a scene", "transforms.json"]);
    Model::small(3).write_binary(folder.path());
    fails(folder.path(), &["photo folder", "images", "does not exist"]);
    fs::create_dir(folder.path().join("images")).unwrap();
    fails(folder.path(), &["none of the 3 photos", "images.bin", "a0.png"]);
    let options = LoadOptions { images: Some("../x".into()), ..Default::default() };
    fails_with(folder.path(), &options, &["`data.images`", "../x"]);
}

#[test]
fn records_that_make_no_sense() {
    changed_fails(|m| m.images.clear(), &["images.", "lists no images"]);
    changed_fails(|m| m.images.truncate(1), &["has 1 view, at least 2"]);
    changed_fails(|m| m.images[1].q = [0.0; 4], &["image `a1.png`", "quaternion has norm 0"]);
    // One photo without a finite pose is left out, and so are all.
    changed_fails(|m| m.images.iter_mut().for_each(|image| image.q[2] = f64::NAN), &["image `a0.png`", "not finite"]);
    changed_fails(|m| m.images.iter_mut().skip(1).for_each(|image| image.t[0] = f64::INFINITY), &["has 1 view,"]);
    changed_fails(|m| m.images[2].camera = 9, &["image `a2.png`", "camera 9 is not in"]);
    changed_fails(|m| m.images[1].name = "a0.png".into(), &["`a0.png` is listed twice"]);
    for name in
        ["../a0.png", "/etc/x0.png", "x/../../a0.png", "C:/x0.png", "..\\a0.png", "/../a0.png", "C:/x/../a0.png"]
    {
        changed_fails(|m| m.images[0].name = name.into(), &["images.", name, "`..`"]);
    }
    changed_fails(|m| m.cameras[0].params[0] = 0.0, &["cameras.", "camera 1", "focal length"]);
    changed_fails(|m| m.cameras[0].params[1] = -5.0, &["camera 1", "focal length"]);
    changed_fails(|m| m.cameras[0].params[0] = f64::NAN, &["camera 1", "focal length"]);
    changed_fails(|m| m.cameras[0].params[2] = f64::INFINITY, &["camera 1", "principal point"]);
    changed_fails(|m| m.cameras[0].size[0] = 0, &["camera 1", "0 x 8 is empty"]);
    changed_fails(|m| m.cameras[0].size[1] = u64::MAX, &["camera 1", "too large"]);
    changed_fails(
        |m| {
            m.cameras[0].model = (2, "SIMPLE_RADIAL");
            m.cameras[0].params = vec![10.0, 6.0, 4.0, f64::NAN];
        },
        &["camera 1", "distortion coefficient"],
    );
    changed_fails(
        |m| {
            m.cameras[0].model = (2, "SIMPLE_RADIAL");
            m.cameras[0].params = vec![10.0, 6.0, 4.0, 1e9];
        },
        &["a0.png", "blank"],
    );
    changed_fails(
        |m| {
            m.cameras[0].model = (11, "RAD_TAN_THIN_PRISM_FISHEYE");
            m.cameras[0].params = vec![10.0; 16];
        },
        &["camera 1", "RAD_TAN_THIN_PRISM_FISHEYE is not supported"],
    );
    changed_fails(|m| m.cameras[0].model = (77, "WARPED"), &["camera 1", "is not supported"]);
    let twice = |m: &mut Model| m.cameras.push(m.cameras[0].clone());
    changed_fails(twice, &["cameras.", "camera 1 is listed twice"]);
}

#[test]
fn counts_that_lie() {
    let model = Model::small(3);
    let files = [("cameras", model.cameras_bin()), ("images", model.images_bin()), ("points3D", model.points_bin())];
    for (stem, bytes) in files {
        let folder = model.scene();
        let path = folder.path().join(format!("sparse/0/{stem}.bin"));
        let file = format!("{stem}.bin");
        for lie in [u64::MAX, u64::MAX / 24, 1 << 40] {
            let mut damaged = bytes.clone();
            damaged[..8].copy_from_slice(&lie.to_le_bytes());
            write_file(&path, damaged);
            fails(folder.path(), &[&file, &lie.to_string(), "at byte 0", "room for"]);
        }
        let mut fewer = bytes.clone();
        fewer[0] -= 1;
        write_file(&path, fewer);
        fails(folder.path(), &[&file, "bytes left"]);
    }
    // The number of observations of the first image stands after its name.
    let folder = model.scene();
    let mut images = model.images_bin();
    let at = 8 + 4 + 56 + 4 + "a0.png".len() + 1;
    images[at..at + 8].copy_from_slice(&u64::MAX.to_le_bytes());
    write_file(&folder.path().join("sparse/0/images.bin"), images);
    fails(folder.path(), &["images.bin", "observations", &format!("at byte {at}")]);
}

#[test]
fn truncation_at_every_byte() {
    let model = Model::small(3);
    let files = [("cameras", model.cameras_bin()), ("images", model.images_bin()), ("points3D", model.points_bin())];
    for (stem, bytes) in files {
        let folder = model.scene();
        let path = folder.path().join(format!("sparse/0/{stem}.bin"));
        for length in 0..bytes.len() {
            write_file(&path, &bytes[..length]);
            fails(folder.path(), &[&format!("{stem}.bin")]);
            assert!(dataset::inspect(folder.path()).is_err());
        }
        write_file(&path, &bytes);
        assert!(dataset::load(folder.path(), &LoadOptions::default()).is_ok());
    }
    let folder = model.scene();
    let bytes = model.images_bin();
    write_file(&folder.path().join("sparse/0/images.bin"), &bytes[..bytes.len() - 24 * 2 - 8]);
    let end = format!("ends at byte {}", bytes.len() - 56);
    fails(folder.path(), &["images.bin", &end, "observations"]);
}

#[test]
fn every_byte_damaged() {
    let model = Model::small(2);
    let files = [("cameras", model.cameras_bin()), ("images", model.images_bin()), ("points3D", model.points_bin())];
    for (stem, bytes) in files {
        let folder = model.scene();
        let path = folder.path().join(format!("sparse/0/{stem}.bin"));
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0xff;
            write_file(&path, damaged);
            // Some damage is harmless; none may panic.
            let _ = dataset::load(folder.path(), &LoadOptions { random_points: 4, ..Default::default() });
        }
    }
}

#[test]
fn text_errors_name_the_line() {
    let model = Model::small(3);
    let folder = model.scene();
    fs::remove_dir_all(folder.path().join("sparse")).unwrap();
    let broken = |stem: &str, from: &str, to: &str, fragments: &[&str]| {
        model.write_text(folder.path());
        let path = folder.path().join(format!("sparse/{stem}.txt"));
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{text}");
        write_file(&path, text.replacen(from, to, 1));
        fails(folder.path(), fragments);
    };
    broken("cameras", " 12 ", " twelve ", &["cameras.txt", "line 2", "width `twelve`"]);
    broken("cameras", " 3.75", "", &["cameras.txt", "line 2", "parameter 4 of 4 is missing"]);
    broken("cameras", " 3.75", " 3.75 1", &["cameras.txt", "line 2", "more than 4"]);
    broken("images", " a1.png", "", &["images.txt", "line 5", "name is missing"]);
    broken("images", "0.9", "O.9", &["images.txt", "line 3", "rotation `O.9`"]);
    broken("images", "1.5 2.5 7 3.0 4.0 -1 \n", "", &["images.txt", "line 4", "triples"]);
    broken("points3D", "200", "300", &["points3D.txt", "line 2", "colour `300`"]);
    model.write_text(folder.path());
    write_file(&folder.path().join("sparse/images.txt"), b"# \xff\n");
    fails(folder.path(), &["images.txt", "byte 2", "UTF-8"]);
}

#[test]
fn photos_that_do_not_decode() {
    let folder = Model::small(3).scene();
    let photo = folder.path().join("images/a1.png");
    let whole = fs::read(&photo).unwrap();
    for bytes in [&b"not a photo"[..], &[], &whole[..whole.len() / 2]] {
        write_file(&photo, bytes);
        fails(folder.path(), &["photo", "a1.png does not decode"]);
    }
    write_file(&photo, whole);
    let jpeg = folder.path().join("images/whole.jpg");
    write_photo(&jpeg, 12, 8, |u, v| [(u * 20.0) as u8, (v * 30.0) as u8, 7, 255]);
    let whole_jpeg = fs::read(&jpeg).unwrap();
    for length in 0..whole_jpeg.len() {
        write_file(&photo, &whole_jpeg[..length]);
        fails(folder.path(), &["a1.png does not decode"]);
    }
    // Bytes after the end are harmless: phones append films and depth maps.
    write_file(&photo, [&whole_jpeg[..], &[0xff, 0xda, 1]].concat());
    assert!(dataset::load(folder.path(), &LoadOptions::default()).is_ok());
    write_file(&folder.path().join("masks/a1.png"), b"no mask");
    fails(folder.path(), &["masks", "a1.png does not decode"]);
}
