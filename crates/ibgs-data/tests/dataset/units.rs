//! Any unit, any place: a scene gives the same local numbers however it is scaled and wherever it lies.

use super::load_plain;
use glam::DVec3;
use ibgs_data::camera::Camera;
use ibgs_data::dataset::{Dataset, LoadOptions};
use ibgs_testing::scene_files::copy_scene;
use ibgs_testing::tiny_demo;

/// Cameras and points as a training sees them.
fn local(dataset: &Dataset) -> (Vec<Camera>, Vec<DVec3>) {
    let space = dataset.space();
    let points = dataset.points.iter().map(|point| point.to_local(&space).position).collect();
    (dataset.views.iter().map(|view| space.camera(&view.camera)).collect(), points)
}

#[test]
fn a_scaled_and_moved_scene_has_the_same_local_numbers() {
    let cache = tempfile::tempdir().unwrap();
    let scene = ibgs_demo::load(&tiny_demo(), Some(cache.path()), &()).unwrap().path;
    let usual = load_plain(&scene);
    let (cameras, points) = local(&usual);
    // The cameras are about five local units apart, and their middle is the origin.
    let farthest = cameras.iter().map(|camera| camera.center().length()).fold(0.0, f64::max);
    assert!((4.0..6.0).contains(&farthest), "{farthest}");
    let shift = DVec3::new(5e6, -4e6, 300.0);
    for (scale, shift) in [(1e-4, DVec3::ZERO), (1e4, DVec3::ZERO), (1.0, shift), (30.0, shift), (1e4, shift)] {
        let folder = tempfile::tempdir().unwrap();
        copy_scene(&scene, folder.path(), scale, shift);
        let moved = load_plain(folder.path());
        // What is loaded is the scene's own.
        let there = usual.views[3].camera.center() * scale + shift;
        assert!(moved.views[3].camera.center().distance(there) < 1e-12 * there.length());
        // Doubles that far from the origin have no more digits.
        let tolerance = 1e-9_f64.max(1e-14 * shift.length() / moved.space().scale);
        let (moved_cameras, moved_points) = local(&moved);
        for (a, b) in cameras.iter().zip(&moved_cameras) {
            assert!(a.center().distance(b.center()) < tolerance && a.view_from_world == b.view_from_world);
        }
        assert!(points.iter().zip(&moved_points).all(|(a, b)| a.distance(*b) < tolerance * (1.0 + a.length())));
    }
    // Random points follow their cameras.
    let random = |scale: f64, shift: DVec3| {
        let folder = tempfile::tempdir().unwrap();
        copy_scene(&scene, folder.path(), scale, shift);
        std::fs::remove_file(folder.path().join("points3D.ply")).unwrap();
        local(&super::load(folder.path(), &LoadOptions { random_points: 50, ..LoadOptions::default() })).1
    };
    let (here, there) = (random(1.0, DVec3::ZERO), random(30.0, shift));
    assert!(here.len() == 50 && here.iter().zip(&there).all(|(a, b)| a.distance(*b) < 1e-6 * a.length()));
}

/// Neither which views are held out nor where the points lie changes the local space.
#[test]
fn the_split_and_the_points_do_not_count() {
    let cache = tempfile::tempdir().unwrap();
    let mut dataset = ibgs_demo::load(&tiny_demo(), Some(cache.path()), &()).unwrap();
    let space = dataset.space();
    std::mem::swap(&mut dataset.train, &mut dataset.test);
    dataset.points.truncate(1);
    assert_eq!(dataset.space(), space);
}
