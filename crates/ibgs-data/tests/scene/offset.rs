//! PLY files in scene units, and what becomes of coordinates that no float holds.

use super::{ply_bytes, random_gaussians, random_points, read_bytes};
use glam::DVec3;
use ibgs_data::dataset::parse_points_ply;
use ibgs_data::local_space::LocalSpace;
use ibgs_data::scene::{Gaussians, PlyFlavor, write_points_ply};
use std::path::Path;

/// Largest difference of two models in the scene, in units of `scale`.
fn difference(a: &Gaussians, b: &Gaussians, scale: f64) -> f64 {
    let means = a.positions().zip(b.positions()).map(|(a, b)| a.distance(b) / scale);
    let logs = |g: &Gaussians| -> Vec<f64> {
        g.log_scales.as_flattened().iter().map(|&s| f64::from(s) + (g.space.scale / scale).ln()).collect()
    };
    let scales = logs(a).into_iter().zip(logs(b)).map(|(a, b)| (a - b).abs());
    let offset = |g: &Gaussians, i: usize| f64::from(g.offsets[i]) * g.space.scale / scale;
    let offsets = (0..a.len()).map(|i| (offset(a, i) - offset(b, i)).abs());
    assert!(a.rotations == b.rotations && a.sh == b.sh && a.normals == b.normals);
    means.chain(scales).chain(offsets).fold(0.0, f64::max)
}

#[test]
fn models_are_written_in_scene_units() {
    for (origin, scale, offset) in [
        ([3.0, -1.0, 0.5], 30.0, None),
        ([0.0, 0.0, 1e-3], 1e-4, None),
        ([5e6 + 0.25, -4e6, 17.0], 1.5, Some("comment offset 5000000 -4000000 17\n")),
        ([5e6 + 0.25, -4e6, 17.0], 1.0, Some("comment offset 5000000.25 -4000000 17\n")),
        ([5e6, -4e6, 17.0], 1e-4, Some("comment offset 5000000 -4000000 17\n")),
        ([5e6, -4e6, 17.0], 1e4, None),
    ] {
        let space = LocalSpace { origin: origin.into(), scale };
        let model = Gaussians { space, ..random_gaussians(20, 1, 3) };
        let bytes = ply_bytes(&model, PlyFlavor::Full);
        let text = String::from_utf8_lossy(&bytes);
        assert_eq!(text.contains("comment"), offset.is_some(), "{space:?}");
        assert!(offset.is_none_or(|offset| text.contains(offset)), "{}", &text[..200]);
        let read = read_bytes(&bytes).unwrap();
        assert_eq!(read.space.scale, 1.0);
        assert!(difference(&model, &read, scale) < 1e-4, "{space:?}: {}", difference(&model, &read, scale));
        // Back in the space that it came from.
        let back = read.into_space(space);
        let apart = model.means.as_flattened().iter().zip(back.means.as_flattened()).map(|(a, b)| (a - b).abs());
        assert!(apart.fold(0.0, f32::max) < 1e-4, "{space:?}");
    }
}

#[test]
fn doubles_far_from_the_origin_keep_their_digits() {
    let fields = "f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let fields: String = fields.split(' ').map(|field| format!("property float {field}\n")).collect();
    let file = |comment: &str, places: &[&str]| {
        let rows: String = places.iter().map(|place| format!("{place} 0 0 0 1 -3 -3 -3 1 0 0 0\n")).collect();
        let doubles = "property double x\nproperty double y\nproperty double z\n";
        let count = places.len();
        read_bytes(
            format!("ply\nformat ascii 1.0\n{comment}element vertex {count}\n{doubles}{fields}end_header\n{rows}")
                .as_bytes(),
        )
    };
    let places = ["5000000.001 4000000.5 1", "5000001.002 4000000.25 2", "5000002.125 4000001.75 3.001"];
    let expected = [[5000000.001, 4000000.5, 1.0], [5000001.002, 4000000.25, 2.0], [5000002.125, 4000001.75, 3.001]];
    for (comment, shift) in [("", DVec3::ZERO), ("comment offset 100 -0.5 7\n", DVec3::new(100.0, -0.5, 7.0))] {
        let model = file(comment, &places).unwrap();
        for (found, expected) in model.positions().zip(expected) {
            assert!(found.distance(shift + DVec3::from(expected)) < 1e-6, "{found}");
        }
    }
    // Coordinates that floats hold stay as they are.
    assert_eq!(file("", &["1.5 2 3"]).unwrap().space, LocalSpace::default());
    let error = file("comment offset 1e13 0 0\n", &places).unwrap_err().to_string();
    assert!(error.contains("model.ply") && error.contains("offset 1e13 0 0"), "{error}");
    assert_eq!(file("comment offset was removed\n", &["1 2 3"]).unwrap().space, LocalSpace::default());
}

#[test]
fn points_far_from_the_origin_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("input.ply");
    let far = DVec3::new(5e6, 4e6, -2e6);
    let mut points = random_points(9, 5);
    points.iter_mut().for_each(|point| point.position += far);
    write_points_ply(&path, &points, LocalSpace::at(far)).unwrap();
    let read = parse_points_ply(Path::new("input.ply"), &std::fs::read(&path).unwrap()).unwrap();
    for (a, b) in points.iter().zip(&read) {
        assert!(a.position.distance(b.position) < 1e-5 && a.color == b.color);
    }
}
