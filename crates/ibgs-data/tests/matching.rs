//! Cameras of a scene without observations are found by its photos alone.

use glam::DVec3;
use ibgs_data::camera::Camera;
use ibgs_data::camera_change::CameraChange;
use ibgs_data::dataset::HostPhoto;
use ibgs_data::matching::adjust_to_photos;
use ibgs_data::similarity::Similarity;
use ibgs_demo::DemoOptions;

/// Mean angle in degrees, and mean distance.
fn missed(found: &[Camera], truth: &[Camera]) -> [f64; 2] {
    let pairs: Vec<_> = found.iter().copied().zip(truth.iter().copied()).collect();
    let frame = Similarity::fit(&pairs);
    let each = pairs.iter().map(|(found, truth)| frame.residual(found, truth));
    each.fold([0.0; 2], |[a, b], (angle, distance)| {
        [a + angle.to_degrees() / pairs.len() as f64, b + distance / pairs.len() as f64]
    })
}

#[test]
fn cameras_fit_what_their_photos_have_in_common() {
    let options = DemoOptions { width: 200, height: 150, views: 20, samples: 2, points: 100, seed: 0 };
    let cache = tempfile::tempdir().unwrap();
    let demo = ibgs_demo::load(&options, Some(cache.path()), &()).unwrap();
    let photos: Vec<&HostPhoto> = demo.views.iter().map(|view| &view.photo).collect();
    let truth: Vec<Camera> = demo.views.iter().map(|view| view.camera).collect();
    let off = |(i, camera): (usize, &Camera)| {
        let way =
            |a: f64| DVec3::new((2.4 * i as f64 + a).sin(), (2.4 * i as f64 + a).cos(), (1.1 * i as f64 - a).sin());
        let (rotation, translation) = (way(0.0) * 0.7_f64.to_radians(), way(1.0) * 0.01 * camera.center().length());
        camera.changed(&CameraChange { rotation, translation, ..CameraChange::default() })
    };
    let given: Vec<Camera> = truth.iter().enumerate().map(off).collect();
    let (adjusted, tracks) = adjust_to_photos(&given, &photos, &()).unwrap().unwrap();
    let [before, after] = [&given, &adjusted.cameras].map(|cameras| missed(cameras, &truth));
    println!(
        "{} tracks, pixels {:.3?}, degrees and distance from {before:.4?} to {after:.4?}",
        tracks.len(),
        adjusted.errors
    );
    assert!(before[0] > 0.5 && after[0] < 0.3 * before[0] && after[1] < 0.3 * before[1], "{before:?} {after:?}");
    // The same bits, whatever the threads did.
    let (again, _) = adjust_to_photos(&given, &photos, &()).unwrap().unwrap();
    assert_eq!(again.cameras, adjusted.cameras);
    // Those that are right stay.
    let (kept, _) = adjust_to_photos(&truth, &photos, &()).unwrap().unwrap();
    let kept = missed(&kept.cameras, &truth);
    assert!(kept[0] < 0.02 * before[0] && kept[1] < 0.02 * before[1], "{kept:?}");
}
