//! Real scenes, where they are present: sizes, splits, and points that have the colour of their photos.

use crate::dataset::{assert_note, load, load_plain};
use glam::DVec2;
use ibgs_data::dataset::{self, Dataset, LoadOptions};
use ibgs_testing::shared;

/// Share of the points whose colour is that of the photos that see them, as a check of axes and intrinsics.
fn agreeing_points(dataset: &Dataset) -> f64 {
    let (mut agree, mut seen) = (0_usize, 0_usize);
    for point in dataset.points.iter().step_by(7) {
        for view in &dataset.views {
            let (uv, depth) = view.camera.project(point.position);
            let (w, h) =
                (f64::from(view.photo.pixels().unwrap().width), f64::from(view.photo.pixels().unwrap().height));
            if depth <= 0.0 || !(0.0..w).contains(&uv.x) || !(0.0..h).contains(&uv.y) {
                continue;
            }
            seen += 1;
            let at = (uv.y as usize * view.photo.pixels().unwrap().width as usize + uv.x as usize) * 4;
            let distance =
                |c: usize| (i32::from(view.photo.pixels().unwrap().rgba[at + c]) - i32::from(point.color[c])).abs();
            agree += usize::from((0..3).all(|channel| distance(channel) < 40));
        }
    }
    assert!(seen > 1000);
    agree as f64 / seen as f64
}

#[test]
fn real_scenes() {
    let eval = LoadOptions { eval: true, ..Default::default() };
    let expected = [
        ("fox", 50, 43, [540, 960], DVec2::new(279.1, 483.6)),
        ("fern", 20, 17, [960, 720], DVec2::new(480.0, 360.0)),
        ("fox_nerf", 50, 43, [270, 480], DVec2::new(138.6395, 241.317)),
    ];
    for (name, views, train, size, principal) in expected {
        let Some(path) = shared(&format!("data/{name}"), "dataset_real::real_scenes") else {
            continue;
        };
        let dataset = load(&path, &eval);
        assert_eq!((dataset.views.len(), dataset.train.len()), (views, train), "{name}");
        let camera = dataset.views[0].camera;
        assert_eq!([camera.width, camera.height], size);
        assert!((camera.principal - principal).length() < 0.1, "{}", camera.principal);
        let share = agreeing_points(&dataset);
        eprintln!("{name}: {} points, {share:.3} agree, {:?}", dataset.points.len(), dataset.notes);
        assert!(share > 0.55, "{name}: only {share} of the points have the colour of their photos");
    }
}

#[cfg(unix)]
#[test]
fn real_scene_with_missing_photos() {
    let Some(path) = shared("data/fox_nerf", "dataset_real::real_scene_with_missing_photos") else {
        return;
    };
    let path = path.canonicalize().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let link = |from: &str, to: &str| {
        std::os::unix::fs::symlink(path.join(from), folder.path().join(to)).unwrap();
    };
    link("images", "images");
    link("sparse_pc.ply", "sparse_pc.ply");
    link("transforms_67_frames_17_missing.json", "transforms.json");
    let dataset = load_plain(folder.path());
    assert_eq!(dataset.views.len(), 50);
    assert_note(&dataset, "17 of 67 photos do not exist");
    assert_note(&dataset, "intrinsics rescaled");
    assert!((dataset.views[0].camera.principal.x - 138.6395).abs() < 1e-6);
    assert_eq!(dataset::inspect(folder.path()).unwrap().missing.len(), 17);
}
