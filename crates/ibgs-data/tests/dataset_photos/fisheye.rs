//! Photos through a fisheye become those of a pinhole.

use super::{assert_pattern, camera, pattern_scene_through};
use crate::dataset::{assert_note, load_plain, transforms};
use glam::DVec2;
use ibgs_testing::fails;
use ibgs_testing::scene_files::{Camera, Model, write_file, write_photo};
use std::f64::consts::FRAC_PI_2;

/// COLMAP's thin-prism fisheye, of which its other equidistant ones are parts: `k1 k2 p1 p2 k3 k4 s1 s2`. From distorted
/// coordinates to the vector whose length is the angle, by fixed-point iteration.
fn to_angle(target: DVec2, k: [f64; 8]) -> DVec2 {
    let [k1, k2, p1, p2, k3, k4, s1, s2] = k;
    let added = |m: DVec2| {
        let (t2, cross) = (m.length_squared(), m.x * m.y);
        let radial = k1 * t2 + k2 * t2.powi(2) + k3 * t2.powi(3) + k4 * t2.powi(4);
        let x = m.x * radial + 2.0 * p1 * cross + p2 * (t2 + 2.0 * m.x * m.x) + s1 * t2;
        let y = m.y * radial + 2.0 * p2 * cross + p1 * (t2 + 2.0 * m.y * m.y) + s2 * t2;
        DVec2::new(x, y)
    };
    (0..200).fold(target, |m, _| target - added(m))
}

/// Where a pinhole sees what lies at that angle; far away for what it cannot see.
fn to_pinhole(m: DVec2) -> DVec2 {
    let angle = m.length();
    m * if angle > 0.0 { angle.min(FRAC_PI_2 - 1e-3).tan() / angle } else { 1.0 }
}

const RADIAL: [f64; 8] = [0.02, -0.015, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
const OPENCV: [f64; 8] = [0.03, -0.02, 0.0, 0.0, 0.004, -0.001, 0.0, 0.0];
const PRISM: [f64; 8] = [0.03, -0.02, 0.003, -0.002, 0.004, -0.001, 0.005, -0.004];

/// Half angle of 60 degrees across.
fn cases() -> Vec<(Camera, [f64; 8])> {
    let with = |number, name, head: &[f64], k: &[f64]| camera((number, name), &[head, k].concat());
    let (one, two) = ([76.0, 78.0, 63.0], [76.0, 75.0, 84.0, 57.0]);
    let simple = [RADIAL[0], 0., 0., 0., 0., 0., 0., 0.];
    vec![
        (with(8, "SIMPLE_RADIAL_FISHEYE", &one, &RADIAL[..1]), simple),
        (with(9, "RADIAL_FISHEYE", &one, &RADIAL[..2]), RADIAL),
        (with(5, "OPENCV_FISHEYE", &two, &[OPENCV[0], OPENCV[1], OPENCV[4], OPENCV[5]]), OPENCV),
        (with(10, "THIN_PRISM_FISHEYE", &two, &PRISM), PRISM),
        (with(14, "SIMPLE_FISHEYE", &one, &[]), [0.0; 8]),
        (with(15, "FISHEYE", &two, &[]), [0.0; 8]),
    ]
}

#[test]
fn fisheye_photos_become_pinhole() {
    for (camera, k) in cases() {
        let folder = pattern_scene_through(&camera, [320, 240], |p| to_pinhole(to_angle(p, k)));
        let dataset = load_plain(folder.path());
        assert_note(&dataset, "2 photos undistorted");
        assert_note(&dataset, "2 photos through a fisheye: a pinhole shows at most 9");
        let opaque = assert_pattern(&dataset.views[0], 4.0);
        assert!(opaque > 0.99, "{}: {opaque}", camera.model.1);
        // The pinhole keeps focal length and principal point of the fisheye, scaled with the photo.
        let loaded = dataset.views[0].camera;
        assert_eq!(loaded.focal.x, 2.0 * camera.params[0]);
        let at = if ["RADIAL", "SIMPLE"].iter().any(|word| camera.model.1.contains(word)) { 1 } else { 2 };
        assert_eq!(loaded.principal, DVec2::new(camera.params[at], camera.params[at + 1]) * 2.0);
    }
}

#[test]
fn fov_photos_become_pinhole() {
    let omega = 1.1_f64;
    let camera = camera((7, "FOV"), &[90.0, 92.0, 79.0, 61.0, omega]);
    let inverse = |p: DVec2| {
        let r = p.length();
        let known = (r * omega).min(FRAC_PI_2 - 1e-3);
        p * if r > 0.0 { known.tan() / (2.0 * (omega / 2.0).tan()) / r } else { 1.0 }
    };
    let dataset = load_plain(pattern_scene_through(&camera, [320, 240], inverse).path());
    assert_note(&dataset, "through a fisheye");
    assert!(assert_pattern(&dataset.views[0], 4.0) > 0.99);
}

/// An equidistant fisheye of 180 degrees, and one that looks behind itself: the pinhole shows 115 degrees and 125.
#[test]
fn wide_fisheyes_are_cropped_to_what_a_pinhole_shows() {
    for (focal, degrees) in [(160.0 / std::f64::consts::PI, "115 x 99"), (41.67, "125 x 110")] {
        let camera = camera((5, "OPENCV_FISHEYE"), &[focal, focal, 80.0, 60.0, 0.0, 0.0, 0.0, 0.0]);
        let dataset = load_plain(pattern_scene_through(&camera, [960, 720], to_pinhole).path());
        assert_note(&dataset, degrees);
        assert_note(&dataset, "blank edges, which do not count, are at most 0.0 % of a photo");
        assert!(assert_pattern(&dataset.views[0], 6.0) == 1.0);
    }
}

/// A polynomial that folds back: what lies beyond is blank, never shown twice.
#[test]
fn a_fisheye_that_folds_back_is_blank_beyond() {
    let params = [76.0, 76.0, 80.0, 60.0, -0.9, 0.0, 0.0, 0.0];
    let folder = pattern_scene_through(&camera((5, "OPENCV_FISHEYE"), &params), [160, 120], to_pinhole);
    let photo = load_plain(folder.path()).views[0].photo.pixels().unwrap();
    // theta (1 - 0.9 theta^2) turns at theta = 0.609, where the pinhole is at r = 0.697: 53 pixels from the middle.
    let alpha = |x: usize| photo.rgba[(60 * 160 + x) * 4 + 3];
    assert_eq!([80, 130, 136, 159].map(alpha), [255, 255, 0, 0]);
}

#[test]
fn fisheyes_of_transforms_json_are_colmaps() {
    let camera = cases().remove(2).0;
    let colmap = pattern_scene_through(&camera, [160, 120], |p| to_pinhole(to_angle(p, OPENCV)));
    let expected = load_plain(colmap.path());
    let [fx, fy, cx, cy, k1, k2, k3, k4] = camera.params[..] else { panic!("eight parameters") };
    for head in [r#""camera_model": "OPENCV_FISHEYE","#, r#""is_fisheye": true,"#] {
        let head = format!(
            r#"{head} "fl_x": {fx}, "fl_y": {fy}, "cx": {cx}, "cy": {cy}, "w": 160, "h": 120, "k1": {k1}, "k2": {k2},
            "k3": {k3}, "k4": {k4},"#
        );
        let frames = [("images/a0.png", ""), ("images/a1.png", "")];
        write_file(&colmap.path().join("nerf/transforms.json"), transforms(&head, &frames));
        for name in ["a0.png", "a1.png"] {
            let to = colmap.path().join("nerf/images").join(name);
            write_file(&to, std::fs::read(colmap.path().join("images").join(name)).unwrap());
        }
        let scene = colmap.path().join("nerf");
        let ours = load_plain(&scene);
        assert_eq!(ours.views[0].camera.focal, expected.views[0].camera.focal);
        assert!(ours.views[0].photo.pixels().unwrap().rgba == expected.views[0].photo.pixels().unwrap().rgba);
        let info = ibgs_data::dataset::inspect(&scene).unwrap();
        assert_eq!((info.cameras[0].model.as_str(), info.cameras[0].distorted), ("OPENCV_FISHEYE", true));
    }
}

#[test]
fn fisheyes_that_make_no_sense() {
    let mut model = Model::small(2);
    let folder = model.scene();
    let mut refused = |number, name, params: &[f64], fragments: &[&str]| {
        model.cameras[0].model = (number, name);
        model.cameras[0].params = params.to_vec();
        model.write_binary(folder.path());
        fails(folder.path(), &[&["cameras.bin", "camera 1"], fragments].concat());
    };
    // As from an export that forgot the photos' scale.
    refused(5, "OPENCV_FISHEYE", &[0.5, 0.5, 6.0, 4.0, 0.0, 0.0, 0.0, 0.0], &["170.5 x 165.7 degrees", "too short"]);
    refused(5, "OPENCV_FISHEYE", &[9.0, 9.0, 6.0, 4.0, f64::NAN, 0.0, 0.0, 0.0], &["distortion coefficient"]);
    let prism = [9.0, 9.0, 6.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, f64::INFINITY, 0.0];
    refused(10, "THIN_PRISM_FISHEYE", &prism, &["distortion coefficient"]);
    refused(7, "FOV", &[9.0, 9.0, 6.0, 4.0, 3.2], &["omega of FOV"]);
    refused(11, "RAD_TAN_THIN_PRISM_FISHEYE", &[9.0; 16], &["RAD_TAN_THIN_PRISM_FISHEYE is not supported"]);
    let path = folder.path().join("nerf");
    for name in ["a.png", "b.png"] {
        write_photo(&path.join(name), 12, 8, |_, _| [1, 2, 3, 255]);
    }
    let short = r#""camera_model": "OPENCV_FISHEYE", "fl_x": 0.5,"#;
    write_file(&path.join("transforms.json"), transforms(short, &[("a.png", ""), ("b.png", "")]));
    fails(&path, &["transforms.json", "frames[0] (`a.png`)", "too short"]);
}
