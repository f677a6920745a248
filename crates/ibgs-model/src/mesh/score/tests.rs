//! Against values worked out by hand, and files that cannot be used.

use super::*;
use glam::{DMat4, dvec3};
use std::path::PathBuf;

fn row(xs: &[f64], y: f64) -> Cloud {
    Cloud::new(xs.iter().map(|&x| dvec3(x, y, 0.0)).collect())
}

/// Every value without a tolerance is exact in binary.
fn near(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-12
}

#[test]
fn precision_recall_and_f1_by_hand() {
    // Of the mesh, three of four points lie within 0.5 of the truth; of the truth, two of five.
    let mesh = row(&[0.0, 1.0, 2.0, 9.0], 0.25);
    let truth = row(&[0.0, 1.25, 5.0, 6.0, 7.0], 0.0);
    let mesh = Cloud::new([mesh.points, vec![dvec3(1.25, 0.0, 0.3)]].concat());
    let pair = Pair { mesh: &mesh, truth: &truth, wanted: &truth };
    let found = pair.f_score(0.5).unwrap();
    assert_eq!((found.precision, found.recall), (3.0 / 5.0, 2.0 / 5.0));
    assert!(near(found.f1, 0.48), "{found:?}");
    // Strictly nearer: at the distance itself nothing counts.
    let (a, b) = (row(&[0.0], 0.0), row(&[0.0], 1.0));
    let pair = Pair { mesh: &a, truth: &b, wanted: &b };
    assert_eq!(pair.f_score(1.0).unwrap(), FScore { threshold: 1.0, precision: 0.0, recall: 0.0, f1: 0.0 });
    assert_eq!(pair.f_score(1.001).unwrap().f1, 1.0);
    // What no camera can see counts for the precision and not for the recall.
    let all = row(&[0.0, 10.0], 0.0);
    let both = Pair { mesh: &all, truth: &all, wanted: &a };
    assert_eq!(both.f_score(0.1).unwrap().f1, 1.0);
    assert_eq!(Pair { mesh: &a, truth: &all, wanted: &all }.f_score(0.1).unwrap().recall, 0.5);
}

#[test]
fn thinning_weighs_all_places_alike() {
    // A thousand points at one good place and one at a bad one are half right.
    let mut points: Vec<DVec3> = (0..1000).map(|i| dvec3(f64::from(i) * 1e-6, 0.0, 0.0)).collect();
    points.push(dvec3(5.0, 0.0, 0.0));
    let (mesh, truth) = (Cloud::new(points), row(&[0.0], 0.0));
    let pair = Pair { mesh: &mesh, truth: &truth, wanted: &truth };
    assert_eq!(pair.f_score(0.1).unwrap().precision, 0.5);
    let chamfer = pair.chamfer(0.1, 20.0).unwrap();
    assert!((chamfer.accuracy.unwrap() - 2.5).abs() < 1e-3, "{chamfer:?}");
}

#[test]
fn chamfer_by_hand() {
    let mesh = Cloud::new(vec![dvec3(0.0, 0.0, 0.0), dvec3(3.0, 4.0, 0.0), dvec3(100.0, 0.0, 0.0)]);
    let truth = row(&[0.0, 1.0], 0.0);
    let pair = Pair { mesh: &mesh, truth: &truth, wanted: &truth };
    let found = pair.chamfer(0.2, 20.0).unwrap();
    // 0 and the root of 2 * 2 + 4 * 4; the third is too far.
    assert!(near(found.accuracy.unwrap(), 20_f64.sqrt() / 2.0) && near(found.completeness.unwrap(), 0.5), "{found:?}");
    assert!(near(found.chamfer.unwrap(), (20_f64.sqrt() / 2.0 + 0.5) / 2.0));
    let far = row(&[1000.0], 0.0);
    let none = Pair { mesh: &far, truth: &truth, wanted: &truth }.chamfer(0.2, 20.0).unwrap();
    assert_eq!((none.accuracy, none.completeness, none.chamfer), (None, None, None));
}

#[test]
fn spread_points_keep_their_distance_and_cover_the_rest() {
    let cloud = Cloud::of_triangles(&[[0.0; 3], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]], &[[0, 1, 2]], 0.02);
    let spread = cloud.spread(0.2);
    let tree = Nearest::new(&spread.points);
    for &point in &cloud.points {
        assert!(tree.of(point).0 < 0.2, "{point} is not covered");
    }
    for (i, &a) in spread.points.iter().enumerate() {
        assert!(spread.points[..i].iter().all(|&b| a.distance(b) >= 0.2));
    }
    assert!((30..90).contains(&spread.points.len()), "{}", spread.points.len());
    assert_eq!(spread, cloud.spread(0.2));
    assert!(spread.normals.len() == spread.points.len() && spread.normals.iter().all(|&n| n == DVec3::Z));
}

#[test]
fn triangles_are_sampled_evenly() {
    // A right triangle and one that has no area.
    let positions = [[0.0; 3], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0], [1.0, 0.0, 0.0], [9.0; 3]];
    let cloud = Cloud::of_triangles(&positions, &[[0, 1, 2], [0, 1, 3]], 0.1);
    let inside = |p: &DVec3| p.min_element() >= 0.0 && p.x / 3.0 + p.y / 4.0 <= 1.0 + 1e-9 && p.z == 0.0;
    assert!(cloud.points.iter().all(inside));
    let tree = Nearest::new(&cloud.points);
    for i in 0..=20 {
        for j in 0..=20 - i {
            let p = dvec3(3.0 * f64::from(i) / 20.0, 4.0 * f64::from(j) / 20.0, 0.0);
            assert!(tree.of(p).0 < 0.1, "no point near {p}");
        }
    }
    // Three vertices and 50 * 51 / 2 in between.
    assert_eq!(cloud.points.len(), 3 + 1275);
}

#[test]
fn normals_are_compared_where_the_surfaces_meet() {
    let flat = |tilt: f64, height: f64| {
        let point = |x: f64, y: f64| [x as f32, y as f32, (height + tilt * x) as f32];
        let corners = [point(0.0, 0.0), point(1.0, 0.0), point(1.0, 1.0), point(0.0, 1.0)];
        Cloud::of_triangles(&corners, &[[0, 1, 2], [0, 2, 3]], 0.02)
    };
    let (truth, tilted, far) = (flat(0.0, 0.0), flat(0.1, 0.0), flat(0.0, 3.0));
    let error = |mesh: &Cloud| Pair { mesh, truth: &truth, wanted: &truth }.normal_error(0.05).unwrap();
    assert!((error(&tilted).unwrap() - 0.1_f64.atan().to_degrees()).abs() < 1e-3);
    assert_eq!((error(&truth), error(&far)), (Some(0.0), None));
    assert_eq!(error(&Cloud::new(truth.points.clone())), None);
}

fn file(text: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("input");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

fn assert_tells<T: std::fmt::Debug>(result: Result<T, MeshError>, fragments: &[&str]) {
    let text = result.unwrap_err().to_string();
    for fragment in ["input"].iter().chain(fragments) {
        assert!(text.contains(fragment), "`{fragment}` is not in: {text}");
    }
}

#[test]
fn crop_volumes() {
    // An L seen along y; the y of the corners means nothing.
    let text = r#"{"axis_max": 2.0, "axis_min": -1.0, "bounding_polygon": [[0, 9, 0], [4, 9, 0], [4, 9, 1], [1, 9, 1],
        [1, 9, 4], [0, 9, 4]], "class_name": "SelectionPolygonVolume", "orthogonal_axis": "Y", "version_major": 1}"#;
    let (_folder, path) = file(text);
    let volume = CropVolume::read(&path).unwrap();
    for (x, y, z, expected) in [
        (0.5, 0.0, 0.5, true),
        (3.5, 2.0, 0.5, true),
        (0.5, -1.0, 3.5, true),
        (0.5, 2.1, 0.5, false),
        (0.5, -1.1, 0.5, false),
        (2.0, 0.0, 2.0, false),
        (-0.5, 0.0, 0.5, false),
        (4.5, 0.0, 0.5, false),
    ] {
        assert_eq!(volume.holds(dvec3(x, y, z)), expected, "{x} {y} {z}");
    }
    let cloud = Cloud { points: vec![dvec3(2.0, 0.0, 2.0), dvec3(0.5, 0.0, 0.5)], normals: vec![DVec3::X, DVec3::Y] };
    let expected = Cloud { points: vec![dvec3(0.5, 0.0, 0.5)], normals: vec![DVec3::Y] };
    assert_eq!(cloud.cropped(&volume), expected);
}

#[test]
fn crop_volumes_that_cannot_be_used() {
    let of = |axis: &str, min: f64, polygon: &str| {
        format!(r#"{{"orthogonal_axis": "{axis}", "axis_min": {min}, "axis_max": 1, "bounding_polygon": {polygon}}}"#)
    };
    let triangle = "[[0,0,0],[1,0,0],[0,1,0]]";
    for (text, fragment) in [
        (of("w", 0.0, triangle), "`orthogonal_axis` is `w`"),
        (of("z", 1.0, triangle), "`axis_min` 1 is not less than"),
        (of("z", 0.0, "[[0,0,0],[1,0,0]]"), "`bounding_polygon` has 2 corners"),
        (of("z", 0.0, "[[0,0],[1,0,0],[1,1,1]]"), "line 1"),
        (r#"{"orthogonal_axis": "z", "axis_max": 1}"#.to_owned(), "`axis_min`"),
        ("[".to_owned(), "line 1"),
    ] {
        let (_folder, path) = file(text);
        assert_tells(CropVolume::read(&path), &["is no crop volume", fragment]);
    }
    assert_tells(CropVolume::read(&PathBuf::from("nowhere/input")), &["cannot read"]);
}

#[test]
fn transforms() {
    let (_folder, path) = file("0 -2.0e+00 0 1\n2 0 0 2\n0 0 2 3\n0 0 0 1\n");
    let matrix = read_transform(&path).unwrap();
    let cloud = Cloud { points: vec![dvec3(1.0, 1.0, 1.0)], normals: vec![DVec3::X] }.moved(matrix);
    assert_eq!(cloud, Cloud { points: vec![dvec3(-1.0, 4.0, 5.0)], normals: vec![DVec3::Y] });
    assert_ne!(matrix, DMat4::IDENTITY);
    for (text, fragment) in [
        ("1 0 0 0\n0 1 0 0\n", "8 numbers, not 16"),
        ("1 0 0 0\n0 one 0 0", "line 2: `one`"),
        ("1 0 0 NaN", "line 1: `NaN`"),
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 1 1", "last row"),
        ("1 0 0 0\n0 1 0 0\n1 0 0 0\n0 0 0 1", "flat"),
        ("", "0 numbers"),
    ] {
        let (_folder, path) = file(text);
        assert_tells(read_transform(&path), &["is no 4 x 4 matrix", fragment]);
    }
    assert_tells(read_transform(&PathBuf::from("nowhere/input")), &["cannot read"]);
}

const HEADER: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty float y\nproperty float z\n\
    property uchar red\n";

#[test]
fn true_surfaces() {
    let vertices = "0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0 9\n";
    let (_folder, path) = file(format!("{HEADER}end_header\n{vertices}"));
    let points = read_truth(&path, 0.1).unwrap();
    assert_eq!(
        points,
        Cloud::new(vec![dvec3(0.0, 0.0, 0.0), dvec3(1.0, 0.0, 0.0), dvec3(1.0, 1.0, 0.0), dvec3(0.0, 1.0, 0.0)])
    );
    for name in ["vertex_indices", "vertex_index"] {
        let header = format!("{HEADER}element face 1\nproperty list uchar int {name}\nend_header\n");
        let (_folder, path) = file(format!("{header}{vertices}4 0 1 2 3\n"));
        let square = read_truth(&path, 0.1).unwrap();
        assert!(square.points.len() > 200 && square.normals.iter().all(|&n| n == DVec3::Z), "{}", square.points.len());
        let (_folder, path) = file(format!("{header}{vertices}4 0 1 2 4\n"));
        assert_tells(read_truth(&path, 0.1), &["face 0 has vertex 4 of 4"]);
        let (_folder, path) = file(format!("{header}{vertices}4 0 1 -2 3\n"));
        assert_tells(read_truth(&path, 0.1), &["is no PLY file of a surface"]);
    }
}

#[test]
fn true_surfaces_that_cannot_be_used() {
    let with = |data: &str| format!("{HEADER}end_header\n{data}");
    for (text, fragment) in [
        (with("0 0 0 9\n"), "ends before"),
        (with("0 0 0 9\n0 nan 0 9\n0 0 0 9\n0 0 0 9\n"), "vertex 1 is"),
        (with("0 0 0 9\n0 a 0 9\n0 0 0 9\n0 0 0 9\n"), "is no PLY file of a surface"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n".to_owned(), "`y`"),
        (
            "ply\nformat ascii 1.0\nelement vertex 9000000000000\nend_header\n".to_owned(),
            "element `vertex` has no fields",
        ),
        ("ply\nformat ascii 1.0\nelement face 0\nproperty list uchar int i\nend_header\n".to_owned(), "vertex"),
        (with("").replace("vertex 4", "vertex 0"), "no vertices"),
        ("plan\n".to_owned(), "header"),
        (String::new(), "header"),
    ] {
        let (_folder, path) = file(&text);
        assert_tells(read_truth(&path, 0.1), &["is no PLY file of a surface", fragment]);
    }
    assert_tells(read_truth(&PathBuf::from("nowhere/input"), 0.1), &["cannot read"]);
}

#[test]
fn clouds_without_points() {
    let (some, none) = (row(&[0.0], 0.0), Cloud::default());
    let pair = Pair { mesh: &none, truth: &some, wanted: &some };
    assert!(pair.f_score(0.1).unwrap_err().to_string().contains("the mesh has no point"));
    let pair = Pair { mesh: &some, truth: &some, wanted: &none };
    assert!(pair.chamfer(0.1, 1.0).unwrap_err().to_string().contains("the true surface has no point"));
}
