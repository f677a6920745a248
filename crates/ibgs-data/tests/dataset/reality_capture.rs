//! Scenes of RealityCapture: a CSV file of cameras, photos, a point cloud.

use super::{assert_note, load, load_plain};
use glam::{DVec2, DVec3};
use ibgs_data::camera::Camera;
use ibgs_data::dataset::{self, LoadOptions};
use ibgs_testing::fails;
use ibgs_testing::scene_files::{write_file, write_photo, zip_of_folder};
use std::fs;
use std::path::Path;

pub const HEADER: &str = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
                   end_header\n1 2 3\n4 5 6\n";

/// Two level cameras, of which one looks north and one east.
const ROWS: &str = "a.jpg,1,2,3,0,90,0,18,0.05,-0.1,0,0,0,0,0,0\nb.png,4,5,6,90,90,0,36,0,0,-0.02,0.01,0,0,0,0\n";

fn write_photos(scene: &Path) {
    write_photo(&scene.join("images/a.jpg"), 40, 20, |_, _| [90, 80, 70, 255]);
    write_photo(&scene.join("images/deeper/b.png"), 20, 40, |_, _| [90, 80, 70, 255]);
}

fn project(camera: &Camera, point: DVec3) -> DVec2 {
    let view = camera.view_from_world * point + camera.translation;
    assert!(view.z > 0.0, "{point} is behind the camera");
    view.truncate() / view.z * camera.focal + camera.principal
}

#[test]
fn a_scene_of_reality_capture() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path();
    write_photos(scene);
    write_file(&scene.join("Cameras.CSV"), format!("\u{feff}#cameras 2\r\n{HEADER}\r\n{}", ROWS.replace('\n', "\r\n")));
    write_file(&scene.join("other.csv"), "name,x\n");
    let without = load(scene, &LoadOptions { random_points: 50, ..LoadOptions::default() });
    assert_note(&without, "50 random ones stand in");
    write_file(&scene.join("sparse cloud.ply"), PLY);
    let dataset = load_plain(scene);
    assert_note(&dataset, "2 initial points from");
    assert_note(&dataset, "1 photo undistorted");
    let [a, b] = &dataset.views[..] else { panic!("{} views", dataset.views.len()) };
    assert_eq!((a.name.as_str(), b.name.as_str()), ("a.jpg", "b.png"));
    assert_eq!((a.camera.focal, b.camera.focal), (DVec2::splat(20.0), DVec2::splat(40.0)));
    assert!(a.camera.center().distance(DVec3::new(1.0, 2.0, 3.0)) < 1e-12);
    // Two steps north, half a step east, a quarter up: right of and above the principal point.
    let seen = project(&a.camera, DVec3::new(1.5, 4.0, 3.25));
    assert!(seen.distance(DVec2::new(22.0 + 5.0, 6.0 - 2.5)) < 1e-9, "{seen}");
    // Seen to the east, south is at the right.
    let seen = project(&b.camera, DVec3::new(6.0, 4.5, 6.0));
    assert!(seen.distance(DVec2::new(10.0 + 10.0, 20.0)) < 1e-9, "{seen}");
    let info = dataset::inspect(scene).unwrap();
    assert_eq!((info.kind.word(), info.images, info.points, info.cameras.len()), ("reality_capture", 2, 2, 2));
    assert_eq!(info.listing.to_str(), Some("Cameras.CSV"));
    // The file itself and an archive are the same scene.
    assert_eq!(load_plain(&scene.join("Cameras.CSV")).views.len(), 2);
    let archive = tempfile::tempdir().unwrap();
    write_file(&archive.path().join("a.zip"), zip_of_folder(scene, "top/"));
    assert_eq!(load_plain(&archive.path().join("a.zip")).points.len(), 2);
}

#[test]
fn photos_that_are_not_there_or_not_listed() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path();
    write_photos(scene);
    let more = format!("{HEADER}\n{ROWS}gone.jpg,0,0,0,0,0,0,20,0,0,0,0,0,0,0,0\n");
    write_file(&scene.join("cameras.csv"), &more);
    write_photo(&scene.join("images/extra.png"), 5, 5, |_, _| [1; 4]);
    let dataset = load_plain(scene);
    assert_note(&dataset, "1 of 3 photos do not exist");
    assert_note(&dataset, "1 photo has no pose and is not used: images/extra.png");
    // One name for two photos in sub-folders: neither is taken.
    write_photo(&scene.join("images/other/b.png"), 20, 40, |_, _| [1; 4]);
    fails(scene, &["has 1 view, at least 2"]);
    // Beside the list, without a photo folder.
    fs::rename(scene.join("images/a.jpg"), scene.join("a.jpg")).unwrap();
    fs::rename(scene.join("images/other/b.png"), scene.join("b.png")).unwrap();
    fs::remove_dir_all(scene.join("images")).unwrap();
    assert_eq!(load_plain(scene).views.len(), 2);
}
