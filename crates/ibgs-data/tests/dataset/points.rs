//! The initial points: from the model, from PLY files, at random; and which of the model's are used.

use super::{assert_note, load, load_plain};
use glam::{DVec2, DVec3};
use ibgs_data::dataset::{LoadOptions, Point};
use ibgs_testing::fails;
use ibgs_testing::scene_files::{Model, ModelPoint, write_file};

#[test]
fn points_from_ply_or_at_random() {
    let mut model = Model::small(3);
    model.points.clear();
    let folder = model.scene();
    let options = LoadOptions { random_points: 500, seed: 4, ..Default::default() };
    let random = load(folder.path(), &options);
    assert_eq!(random.points.len(), 500);
    assert_note(&random, "500 random ones");
    let again = load(folder.path(), &options);
    assert!(random.points.iter().zip(&again.points).all(|(a, b)| a.position == b.position));
    for point in &random.points {
        assert_eq!(point.color, [90, 120, 150]);
        let seen = random.views.iter().any(|view| {
            let (uv, depth) = view.camera.project(point.position);
            let inside = uv.cmpge(DVec2::ZERO).all() && uv.x <= 12.0 && uv.y <= 8.0;
            depth > 0.0 && inside
        });
        assert!(seen);
    }
    let header = |format: &str, count: u32| {
        format!(
            "ply\r\nformat {format} 1.0\ncomment made by hand\nelement vertex {count}\nproperty double x\nproperty \
             float nx\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar \
             blue\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let mut little = header("binary_little_endian", 1).into_bytes();
    little.extend(1.5_f64.to_le_bytes());
    [0.0_f32, -2.0, 3.25].iter().for_each(|value| little.extend(value.to_le_bytes()));
    little.extend([9, 8, 7]);
    let mut big = header("binary_big_endian", 1).into_bytes();
    big.extend(1.5_f64.to_be_bytes());
    [0.0_f32, -2.0, 3.25].iter().for_each(|value| big.extend(value.to_be_bytes()));
    big.extend([9, 8, 7]);
    let ascii = header("ascii", 2) + "1.5 0 -2 3.25 9 8 7\nnan 0 0 0 1 1 1\n";
    for bytes in [little, big, ascii.into_bytes()] {
        write_file(&folder.path().join("points3D.ply"), bytes);
        let loaded = load(folder.path(), &options);
        assert_eq!(loaded.points.len(), 1);
        assert_eq!(loaded.points[0].position, DVec3::new(1.5, -2.0, 3.25));
        assert_eq!(loaded.points[0].color, [9, 8, 7]);
        assert_note(&loaded, "initial points from");
    }
    assert_note(&load_plain(folder.path()), "1 initial points are not finite");
}

/// `init.ply` is somebody's choice, `points3D.ply` stands in for points that a model lacks.
#[test]
fn which_file_the_points_come_from() {
    let one = |x: u32| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n{x} 0 9\n"
        )
    };
    let mut model = Model::small(3);
    let folder = model.scene();
    let first = || load_plain(folder.path()).points[0].position.x;
    assert_eq!(first(), 0.1);
    write_file(&folder.path().join("points3D.ply"), one(5));
    assert_eq!(first(), 0.1);
    write_file(&folder.path().join("init.ply"), one(7));
    assert_eq!(first(), 7.0);
    assert_note(&load_plain(folder.path()), "1 initial points from");
    std::fs::remove_file(folder.path().join("init.ply")).unwrap();
    model.points.clear();
    model.write_binary(folder.path());
    assert_eq!(first(), 5.0);
    write_file(&folder.path().join("init.ply"), "ply\nformat");
    fails(folder.path(), &["init.ply", "end_header"]);
}

#[test]
fn colours_of_ply_points() {
    let mut model = Model::small(2);
    model.points.clear();
    let folder = model.scene();
    let color = |properties: &str, values: &str| {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
             {properties}end_header\n1 2 3 {values}\n"
        );
        write_file(&folder.path().join("init.ply"), text);
        let Point { position, color } = load_plain(folder.path()).points[0];
        assert_eq!(position, DVec3::new(1.0, 2.0, 3.0));
        color
    };
    let three = |kind: &str, names: [&str; 3]| names.map(|name| format!("property {kind} {name}\n")).concat();
    let rgb = ["red", "green", "blue"];
    assert_eq!(color("", ""), [128; 3]);
    assert_note(&load_plain(folder.path()), "init.ply, which has no colours: they begin grey");
    assert_eq!(color(&three("float", ["nx", "ny", "nz"]), "0 0 1"), [128; 3]);
    assert_eq!(color(&(three("float", ["nx", "ny", "nz"]) + &three("uchar", rgb)), "0 0 1 7 8 9"), [7, 8, 9]);
    assert_eq!(color(&three("float", rgb), "0.2 1 0"), [51, 255, 0]);
    assert_note(&load_plain(folder.path()), "1 initial points from");
    // The largest value says what white is.
    assert_eq!(color(&three("float", rgb), "200.2 255 0"), [200, 255, 0]);
    assert_eq!(color(&three("double", rgb), "65535 257 0"), [255, 1, 0]);
    assert_eq!(color(&three("float", rgb), "1.02 0.5 0"), [255, 128, 0]);
    let diffuse = ["diffuse_red", "diffuse_green", "diffuse_blue"];
    assert_eq!(color(&three("uchar", diffuse), "7 8 9"), [7, 8, 9]);
    assert_eq!(color(&three("uchar", ["r", "g", "b"]), "7 8 9"), [7, 8, 9]);
    assert_eq!(color(&three("ushort", rgb), "65535 257 129"), [255, 1, 1]);
    // Gaussians: 0.5 + 0.2821 dc.
    assert_eq!(color(&three("float", ["f_dc_0", "f_dc_1", "f_dc_2"]), "0 1.7725 -9"), [128, 255, 0]);
}

/// A model with points of several errors and tracks.
fn tracked() -> Model {
    let mut model = Model::small(4);
    let point = |x: f64, error: f64, images: &[u32]| ModelPoint {
        xyz: [x, 0.0, 3.0],
        rgb: [9; 3],
        error,
        track: images.iter().map(|image| (*image, 0)).collect(),
    };
    model.points = vec![
        point(1.0, 0.5, &[1, 2, 3]),
        point(2.0, 2.0, &[4, 2, 3, 1]),
        point(3.0, 2.01, &[1, 2, 3]),
        point(4.0, 0.5, &[1, 2]),
        // Two images, one of them twice.
        point(5.0, 0.5, &[1, 2, 2]),
        point(6.0, -1.0, &[1, 2, 3]),
    ];
    model
}

#[test]
fn unreliable_points_are_left_out_when_asked() {
    let options = LoadOptions { filter_points: true, ..Default::default() };
    let used = |model: &Model, binary: bool, options: &LoadOptions| {
        let folder = tempfile::tempdir().unwrap();
        if binary {
            model.write_binary(folder.path())
        } else {
            model.write_text(folder.path())
        }
        model.write_photos(folder.path());
        let dataset = load(folder.path(), options);
        (dataset.points.iter().map(|p| p.position.x).collect::<Vec<f64>>(), dataset.notes.join("; "))
    };
    for binary in [true, false] {
        let model = tracked();
        assert_eq!(used(&model, binary, &LoadOptions::default()).0, [1., 2., 3., 4., 5., 6.]);
        let (kept, notes) = used(&model, binary, &options);
        assert_eq!(kept, [1., 2., 6.]);
        assert!(notes.contains("filter-points: 3 of 6 points left out"), "{notes}");
        let mut untracked = tracked();
        untracked.points.iter_mut().for_each(|point| point.track.clear());
        let (kept, notes) = used(&untracked, binary, &options);
        assert!(kept.len() == 6 && notes.contains("no tracks"), "{notes}");
        let mut bad = tracked();
        bad.points.iter_mut().for_each(|point| point.error = 3.0);
        let (kept, notes) = used(&bad, binary, &options);
        assert!(kept.len() == 6 && notes.contains("would leave no point"), "{notes}");
    }
}

#[test]
fn tracks_that_make_no_sense() {
    let model = Model::small(2);
    let folder = tempfile::tempdir().unwrap();
    model.write_photos(folder.path());
    model.write_text(folder.path());
    let path = folder.path().join("sparse/points3D.txt");
    let whole = std::fs::read_to_string(&path).unwrap();
    let broken = |from: &str, to: &str, fragments: &[&str]| {
        assert!(whole.contains(from), "{whole}");
        write_file(&path, whole.replacen(from, to, 1));
        fails(folder.path(), &[&["points3D.txt", "line 2"], fragments].concat());
    };
    broken(" 0.5 1 0 2 1", "", &["the point error is missing"]);
    broken(" 0.5 1 0 2 1", " small 1 0 2 1", &["point error `small`"]);
    broken(" 0.5 1 0 2 1", " 0.5 1 0 2", &["observation of the track is missing"]);
    broken(" 0.5 1 0 2 1", " 0.5 1 0 two 1", &["image id of the track `two`"]);
}
