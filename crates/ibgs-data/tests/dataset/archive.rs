//! Scenes in ZIP archives, whole and hostile.

use super::{load, load_plain};
use ibgs_data::dataset::{self, LoadOptions};
use ibgs_testing::fails;
use ibgs_testing::scene_files::{Model, write_file, zip_of, zip_of_folder};
use std::fs;
use std::path::{Path, PathBuf};

/// The small scene, zipped with a prefix for its names.
fn scene_zip(folder: &Path, prefix: &str) -> PathBuf {
    let path = folder.join("my.scene.ZIP");
    write_file(&path, zip_of_folder(Model::small(3).scene().path(), prefix));
    path
}

#[test]
fn an_archive_is_its_folder() {
    let folder = tempfile::tempdir().unwrap();
    let plain = load_plain(Model::small(3).scene().path());
    for prefix in ["", "my scene/"] {
        let path = scene_zip(folder.path(), prefix);
        let packed = load_plain(&path);
        assert_eq!(packed.path, path);
        assert_eq!((packed.views.len(), packed.points.len(), packed.notes.len()), (3, 2, 0));
        for (a, b) in packed.views.iter().zip(&plain.views) {
            assert!(
                a.name == b.name
                    && a.camera == b.camera
                    && a.photo.pixels().unwrap().rgba == b.photo.pixels().unwrap().rgba
            );
        }
        let info = dataset::inspect(&path).unwrap();
        assert_eq!((info.path, info.images, info.missing.len()), (path, 3, 0));
    }
}

#[test]
fn what_file_managers_add_does_not_matter() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Model::small(3).scene();
    for name in ["sub/.DS_Store", "sub/Thumbs.db", "__MACOSX/sub/._a0.png"] {
        write_file(&folder.path().join(name), "clutter");
    }
    fs::rename(scene.path().join("images"), folder.path().join("sub/images")).unwrap();
    fs::rename(scene.path().join("sparse"), folder.path().join("sub/sparse")).unwrap();
    let path = scene.path().join("a.zip");
    write_file(&path, zip_of_folder(folder.path(), ""));
    assert_eq!(load_plain(&path).views.len(), 3);
}

/// Messages and notes name the archive, not where it was unpacked.
#[test]
fn trouble_inside_is_told_by_the_archives_name() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Model::small(3).scene();
    let path = folder.path().join("scene.zip");
    fs::remove_file(scene.path().join("images/a1.png")).unwrap();
    write_file(&path, zip_of_folder(scene.path(), "top/"));
    let notes = load(&path, &LoadOptions::default()).notes.join("; ");
    let missing = path.join("top").join("images").join("a1.png");
    assert!(notes.contains(missing.to_str().unwrap()) && !notes.contains("ibgs-scene-"), "{notes}");
    write_file(&scene.path().join("images/a0.png"), "no photo");
    write_file(&path, zip_of_folder(scene.path(), "top/"));
    let photo = path.join("top").join("images").join("a0.png");
    fails(&path, &[photo.to_str().unwrap(), "does not decode"]);
    write_file(&path, zip_of(&[("notes.txt", b"nothing")]));
    fails(&path, &["scene.zip is not a scene"]);
    assert!(dataset::inspect(&path).unwrap_err().to_string().contains("scene.zip is not a scene"));
}

#[test]
fn archives_that_are_none_or_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let path = scene_zip(folder.path(), "");
    let whole = fs::read(&path).unwrap();
    for bytes in [&b"no archive"[..], &[], &whole[..whole.len() / 2], &whole[..whole.len() - 4]] {
        write_file(&path, bytes);
        fails(&path, &["my.scene.ZIP", "no whole ZIP archive"]);
    }
    // A byte of the first photo: the archive's checksum tells.
    let at = whole.windows(4).position(|bytes| bytes == b"IHDR").unwrap();
    let mut damaged = whole.clone();
    damaged[at] ^= 0xff;
    write_file(&path, damaged);
    fails(&path, &["my.scene.ZIP", ".png", "cannot be unpacked"]);
    for at in (0..whole.len()).step_by(7) {
        let mut damaged = whole.clone();
        damaged[at] ^= 0xff;
        write_file(&path, damaged);
        // Some damage is harmless; none may panic.
        let _ = dataset::load(&path, &LoadOptions::default());
    }
}

/// The bytes with all occurrences of a text replaced by one of the same length.
fn replaced(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let mut out = bytes.to_vec();
    let mut found = 0;
    for at in 0..bytes.len() - from.len() {
        if bytes[at..].starts_with(from) {
            out[at..at + to.len()].copy_from_slice(to);
            found += 1;
        }
    }
    assert!(found > 0);
    out
}

#[test]
fn entries_that_leave_the_archive_or_are_no_plain_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("inner/hostile.zip");
    let victim = folder.path().join("victim");
    let plain = zip_of(&[("xx/victim", b"hostile")]);
    for name in ["../victim", "/x/victim", "x/../../v", "C:/victim", "..\\victim"] {
        let mut name = name.as_bytes().to_vec();
        name.resize(9, b'v');
        write_file(&path, replaced(&plain, b"xx/victim", &name));
        fails(&path, &["hostile.zip", "is absolute or contains `..`"]);
    }
    assert!(!victim.exists());
    // Bit 0 of the flags, in the local header and in the directory.
    let flagged =
        replaced(&replaced(&plain, b"PK\x03\x04\x0a\0\0", b"PK\x03\x04\x0a\0\x01"), b"\x0a\0\0\0", b"\x0a\0\x01\0");
    write_file(&path, flagged);
    fails(&path, &["hostile.zip", "`xx/victim` is encrypted"]);
    // The same name twice; and a file where another needs a folder.
    write_file(&path, replaced(&zip_of(&[("same", b"1"), ("some", b"2")]), b"some", b"same"));
    let twice = dataset::load(&path, &LoadOptions::default()).unwrap_err().to_string();
    assert!(twice.contains("hostile.zip"), "{twice}");
    write_file(&path, zip_of(&[("a", b"1"), ("a/b", b"2")]));
    fails(&path, &["hostile.zip", "`a/b` cannot be unpacked"]);
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    writer.add_symlink("images", "/etc", zip::write::SimpleFileOptions::default()).unwrap();
    write_file(&path, writer.finish().unwrap().into_inner());
    fails(&path, &["hostile.zip", "`images` is a link"]);
}

#[test]
fn archives_that_unpack_to_far_more_than_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.zip");
    let zeros = vec![0; 70 << 20];
    let bomb = zip_of(&[("images/zeros.png", &zeros)]);
    assert!(bomb.len() < 1 << 20, "{} bytes", bomb.len());
    write_file(&path, &bomb);
    fails(&path, &["bomb.zip", "it unpacks to more than", "20 times its size and 64 MiB"]);
    // The size in the headers may lie.
    write_file(&path, replaced(&bomb, &(zeros.len() as u32).to_le_bytes(), &1_000_u32.to_le_bytes()));
    fails(&path, &["bomb.zip"]);
    // Two halves that are allowed each.
    let half = &zeros[..40 << 20];
    write_file(&path, zip_of(&[("a", half), ("b", half)]));
    fails(&path, &["bomb.zip", "it unpacks to more than"]);
}
