//! `ibgs prepare` with programs that stand in for COLMAP.

use super::Sandbox;
use ibgs_testing::scene_files::Model;
use image::ImageEncoder;
use image::codecs::jpeg::JpegEncoder;
use std::fs;
use std::os::unix::fs::PermissionsExt;

/// A program that does as COLMAP 3.8 does: two models, the second of which has more photos. The file `broken` makes its mapper fail.
pub(crate) const COLMAP: &str = r#"#!/bin/sh
here=$(dirname "$0")
echo "$@" >> "$here/calls"
case "$1 $2" in
    "-h ") echo "COLMAP 3.8 -- Structure-from-Motion (Commit Unknown without CUDA)" ;;
    "feature_extractor -h") echo "  --SiftExtraction.use_gpu arg (=1)" ;;
    "exhaustive_matcher -h") echo "  --SiftMatching.use_gpu arg (=1)" ;;
    model_analyzer*) echo "Points: 1234"; echo "Mean reprojection error: 0.61px" ;;
    mapper*)
        if [ -e "$here/broken" ]; then echo "no good initial pair" >&2; exit 3; fi
        out=$(echo "$@" | sed 's/.*--output_path //')
        cp -r "$here/models/." "$out"
        echo "Registering image #1 (3)" ;;
esac
"#;

/// What the mapper finds: photos of two models.
fn write_models(sandbox: &Sandbox, first: &[&str], second: &[&str]) {
    for (number, names) in [first, second].into_iter().enumerate() {
        let mut model = Model::small(names.len());
        model.images.iter_mut().zip(names).for_each(|(image, name)| image.name = (*name).to_owned());
        model.write_binary_to(&sandbox.path(&format!("models/{number}")));
    }
}

pub(crate) fn make_program(sandbox: &Sandbox, name: &str, script: &str) {
    sandbox.write(name, script);
    fs::set_permissions(sandbox.path(name), fs::Permissions::from_mode(0o755)).unwrap();
}

pub(crate) fn sandbox() -> Sandbox {
    let sandbox = Sandbox::new();
    for name in ["photos/b.jpg", "photos/a.PNG", "photos/c.jpeg", "photos/notes.txt"] {
        sandbox.write(name, "not looked at");
    }
    write_models(&sandbox, &["a.PNG", "b.jpg"], &["a.PNG", "b.jpg", "c.jpeg"]);
    make_program(&sandbox, "colmap", COLMAP);
    sandbox
}

#[test]
fn photos_become_a_scene_with_the_largest_model_first() {
    let sandbox = sandbox();
    let outcome = sandbox.succeeds("prepare photos -o scene --colmap ./colmap");
    assert!(outcome.stdout.contains("3 of 3 photos have a pose"), "{}", outcome.stdout);
    assert!(outcome.stdout.contains("0.61 pixels, 1234 points") && outcome.stdout.contains("ibgs train scene"));
    assert!(outcome.stderr.contains("2 parts that do not connect"), "{}", outcome.stderr);
    assert!(outcome.stderr.contains("notes.txt"), "{}", outcome.stderr);
    assert!(!outcome.stderr.contains("without a pose"), "{}", outcome.stderr);
    assert_eq!(fs::read(sandbox.path("scene/sparse/0/images.bin")).unwrap()[0], 3);
    assert_eq!(fs::read(sandbox.path("scene/sparse/1/images.bin")).unwrap()[0], 2);
    let mut names: Vec<_> =
        fs::read_dir(sandbox.path("scene/images")).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["a.PNG", "b.jpg", "c.jpeg"]);
    let calls = sandbox.text("calls");
    assert!(calls.contains("--SiftExtraction.use_gpu 0") && calls.contains("--SiftMatching.use_gpu 0"), "{calls}");
    assert!(calls.contains("--ImageReader.camera_model OPENCV"), "{calls}");
    assert!(sandbox.text("scene/prepare.log").contains("Registering image #1 (3)"));
}

#[test]
fn a_failed_step_is_named_and_the_same_command_continues_with_it() {
    let sandbox = sandbox();
    sandbox.write("broken", "");
    let outcome = sandbox.run("prepare photos -o scene --colmap ./colmap");
    outcome.assert_failure(1, &["no two photos overlap", "no good initial pair", "scene/prepare.log"]);
    // What a failed preparation leaves is no scene.
    sandbox.run("prepare scene -o other --colmap ./colmap").assert_failure(1, &["no two photos overlap"]);
    fs::remove_file(sandbox.path("broken")).unwrap();
    fs::remove_file(sandbox.path("calls")).unwrap();
    let other = sandbox.run("prepare photos -o scene --colmap ./colmap --frames 9");
    other.assert_failure(1, &["begun with other photos or options", "--overwrite"]);
    // The same photos by another path.
    sandbox.succeeds("prepare scene/../photos -o scene --colmap ./colmap");
    let calls = sandbox.text("calls");
    assert!(calls.contains("mapper --database_path") && !calls.contains("feature_extractor"), "{calls}");
    let other = sandbox.run("prepare photos -o scene --colmap ./colmap --matching sequential");
    other.assert_failure(1, &["begun with other photos or options", "--overwrite"]);
}

#[test]
fn a_scene_may_be_made_around_its_photos() {
    let sandbox = sandbox();
    fs::create_dir(sandbox.path("place")).unwrap();
    fs::rename(sandbox.path("photos"), sandbox.path("place/photos")).unwrap();
    for (photos, scene) in [("place/photos", "place"), ("place/photos", "place/photos")] {
        let command = format!("prepare {photos} -o {scene} --colmap ./colmap");
        assert!(sandbox.succeeds(&command).stdout.contains("3 of 3 photos have a pose"));
        assert!(sandbox.path(scene).join("images/c.jpeg").exists());
        sandbox.succeeds(&command);
    }
    // Where the originals are gone, the copies are not taken for them.
    for name in ["a.PNG", "b.jpg", "c.jpeg"] {
        fs::remove_file(sandbox.path("place/photos").join(name)).unwrap();
    }
    let outcome = sandbox.run("prepare place/photos -o place/photos --colmap ./colmap --overwrite");
    outcome.assert_failure(1, &["place/photos has 0 photos"]);
    assert!(sandbox.path("place/photos/images/c.jpeg").exists());
}

#[test]
fn own_photos_and_more_continue_and_a_part_of_the_scene_is_no_input() {
    let sandbox = sandbox();
    fs::create_dir(sandbox.path("scene")).unwrap();
    fs::rename(sandbox.path("photos"), sandbox.path("scene/images")).unwrap();
    sandbox.write("more/d.jpg", "another");
    for _ in 0..2 {
        let outcome = sandbox.succeeds("prepare scene/images more -o scene --colmap ./colmap");
        assert!(outcome.stdout.contains("of 4 photos have a pose"), "{outcome}");
    }
    let outcome = sandbox.run("prepare scene/images/02_more -o scene --colmap ./colmap --overwrite");
    outcome.assert_failure(1, &["02_more lies in", "name that folder"]);
    assert!(sandbox.path("scene/images/02_more/d.jpg").exists());
}

#[test]
fn photos_in_folders_are_taken_and_overwriting_begins_anew() {
    let sandbox = sandbox();
    for name in ["trip/day1/a.jpg", "trip/day2/b.jpg", "trip/c.jpg", "trip/.hidden/d.jpg"] {
        sandbox.write(name, "not looked at");
    }
    // The scene lies among the photos.
    sandbox.succeeds("prepare trip -o trip/scene --colmap ./colmap");
    let images = |name: &str| sandbox.path("trip/scene/images").join(name).exists();
    assert!(["day1/a.jpg", "day2/b.jpg", "c.jpg"].into_iter().all(images));
    assert!(![".hidden", "scene"].into_iter().any(images));
    sandbox.write("trip/day2/e.jpg", "one more");
    let changed = sandbox.run("prepare trip -o trip/scene --colmap ./colmap");
    changed.assert_failure(1, &["begun with other photos or options", "--overwrite"]);
    sandbox.succeeds("prepare trip -o trip/scene --colmap ./colmap --overwrite");
    assert!(images("day2/e.jpg") && !images("scene"));
    let outcome = sandbox.run("prepare trip/scene -o other --colmap ./colmap");
    outcome.assert_failure(1, &["has camera poses already", "ibgs train"]);
    assert!(!sandbox.path("other").exists());
}

#[test]
fn what_is_missing_is_said_before_anything_is_written() {
    let sandbox = sandbox();
    sandbox.write("few/a.jpg", "one");
    sandbox.write("scene/sparse/0/images.bin", "poses");
    sandbox.write("own/images/mine.jpg", "mine");
    sandbox.write("empty/read.me", "");
    sandbox.write("walk.mp4", "a video");
    sandbox.fails("prepare photos -o new --colmap ./none", &["./none was not found", "apt install colmap", "--colmap"]);
    sandbox.fails("prepare photos -o new --colmap true", &["is not COLMAP"]);
    make_program(&sandbox, "silent", &COLMAP.replace("echo \"$@\" >> \"$here/calls\"", ""));
    for (arguments, fragments) in [
        ("nowhere -o new", &["nowhere does not exist"][..]),
        ("few -o new", &["few has 1 photo (", "at least 3"]),
        ("empty -o new", &["empty has 0 photos"]),
        ("photos/a.PNG -o new", &["a.PNG is neither a folder of photos nor a video"]),
        ("photos -o scene", &["scene has camera poses already"]),
        ("photos -o own", &["own/images is there already"]),
        ("walk.mp4 -o new --ffmpeg ./none", &["./none was not found", "apt install ffmpeg"]),
    ] {
        sandbox.fails(&format!("prepare {arguments} --colmap ./silent"), fragments);
    }
    make_program(&sandbox, "old", &COLMAP.replace("COLMAP 3.8", "COLMAP 3.5"));
    let outcome = sandbox.run("prepare photos -o new --colmap ./old");
    outcome.assert_failure(1, &["COLMAP 3.5", "3.6 or newer"]);
}

#[test]
fn photos_that_lie_in_the_scene_stay() {
    let sandbox = sandbox();
    fs::create_dir(sandbox.path("scene")).unwrap();
    fs::rename(sandbox.path("photos"), sandbox.path("scene/images")).unwrap();
    sandbox.succeeds("prepare scene/images -o scene --colmap ./colmap");
    for name in ["d.jpg", "e.jpg", "f.jpg"] {
        sandbox.write(&format!("others/{name}"), "another");
    }
    let outcome = sandbox.run("prepare others -o scene --colmap ./colmap --overwrite");
    outcome.assert_failure(1, &["scene/images holds photos that were there before"]);
    assert_eq!(sandbox.text("scene/images/b.jpg"), "not looked at");
}

/// A JPEG file of 32 x 16 pixels that EXIF asks to turn by a quarter: a TIFF header with one entry.
fn portrait() -> Vec<u8> {
    let exif = b"MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 90);
    encoder.set_exif_metadata(exif.to_vec()).unwrap();
    image::RgbImage::from_pixel(32, 16, image::Rgb([200, 10, 10])).write_with_encoder(encoder).unwrap();
    bytes
}

#[test]
fn photos_are_turned_upright_and_masks_are_no_photos() {
    let sandbox = sandbox();
    let names = ["a.jpg", "b.jpg", "c.jpg"];
    names.iter().for_each(|name| sandbox.write(&format!("phone/{name}"), portrait()));
    for mask in ["phone/a_mask.png", "phone/masks/b.jpg.png"] {
        fs::create_dir_all(sandbox.path(mask).parent().unwrap()).unwrap();
        image::GrayImage::new(16, 32).save(sandbox.path(mask)).unwrap();
    }
    write_models(&sandbox, &["a.jpg"], &names);
    let told = sandbox.succeeds("prepare phone -o scene --colmap ./colmap");
    assert!(told.stderr.contains("3 of 3 photos are turned upright in the scene, as their EXIF orientation"), "{told}");
    assert!(told.stderr.contains("2 masks brought to ") && told.stdout.contains("3 of 3 photos have a pose"), "{told}");
    for name in names {
        let size = |folder: &str| image::image_dimensions(sandbox.path(&format!("{folder}/{name}"))).unwrap();
        assert_eq!((size("scene/images"), size("phone")), ((16, 32), (32, 16)), "{name}");
        assert_eq!(fs::read(sandbox.path(&format!("phone/{name}"))).unwrap(), portrait(), "the original stays");
    }
    assert!(!sandbox.path("scene/images/a_mask.png").exists() && !sandbox.path("scene/images/masks").exists());
    let shown = sandbox.succeeds("info scene").stdout;
    assert!(shown.contains("masks of 2 of 3 photos") && !shown.contains("EXIF"), "{shown}");
    // Photos that lie in the scene are the user's own.
    fs::create_dir(sandbox.path("own")).unwrap();
    fs::rename(sandbox.path("phone"), sandbox.path("own/images")).unwrap();
    let told = sandbox.succeeds("prepare own/images -o own --colmap ./colmap");
    assert!(told.stderr.contains("3 of 3 photos have an EXIF orientation and stay as they are"), "{told}");
    assert!(told.stderr.contains("2 masks lie among the photos"), "{told}");
    assert_eq!(fs::read(sandbox.path("own/images/a.jpg")).unwrap(), portrait());
    assert!(sandbox.succeeds("info own").stdout.contains("note: 3 photos have an EXIF orientation"));
}

#[test]
fn photos_without_a_pose_and_formats_that_are_left_out_are_named() {
    let sandbox = sandbox();
    for name in ["photos/d.tiff", "photos/e.WebP", "photos/f.png", "photos/g.png", "photos/h.png", "photos/i.png"] {
        sandbox.write(name, "not looked at");
    }
    for name in ["photos/x.HEIC", "photos/y.heic"] {
        sandbox.write(name, "not looked at");
    }
    // A PNG by its contents.
    image::RgbImage::new(4, 3).save(sandbox.path("b.png")).unwrap();
    fs::rename(sandbox.path("b.png"), sandbox.path("photos/b.jpg")).unwrap();
    write_models(&sandbox, &["a.PNG"], &["b.jpg", "d.tiff", "e.WebP"]);
    let outcome = sandbox.succeeds("prepare photos -o scene --colmap ./colmap");
    assert!(outcome.stdout.contains("3 of 9 photos have a pose"), "{outcome}");
    let unreadable = "8 of 9 photos cannot be read: a.PNG, c.jpeg, d.tiff, e.WebP, f.png, ...";
    assert!(outcome.stderr.contains(unreadable), "{outcome}");
    let without = "6 of 9 photos: images/a.PNG, images/c.jpeg, images/f.png, images/g.png, images/h.png, ...";
    assert!(outcome.stderr.contains(without), "{outcome}");
    assert!(outcome.stderr.contains("3 files left out, such as notes.txt"), "{outcome}");
    assert!(outcome.stderr.contains("2 HEIC photos, such as x.HEIC") && outcome.stderr.contains("`heif-convert`"));
    for name in ["phone/a.heic", "phone/b.heic", "phone/c.heic"] {
        sandbox.write(name, "not looked at");
    }
    make_program(&sandbox, "silent", &COLMAP.replace("echo \"$@\" >> \"$here/calls\"", ""));
    sandbox.fails("prepare phone -o new --colmap ./silent", &["phone has 0 photos", "3 HEIC photos", "`heif-convert`"]);
}
