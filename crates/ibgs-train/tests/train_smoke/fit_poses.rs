//! Held-out cameras that are fitted to their photos.

use super::{dataset, plain};
use crate::small::{run, trainer};
use glam::DVec3;
use ibgs_core::camera::Camera;
use ibgs_core::camera_change::CameraChange;
use ibgs_core::dataset::{Dataset, Photo};
use ibgs_core::eval::fit_pose::{Colors, fit_pose};
use ibgs_core::eval::fitted::{FITTED_POSES_FILE, fitted_views, write_fitted};
use ibgs_core::eval::score_view;
use ibgs_core::output::OutputFolder;
use ibgs_core::render::{Rendered, Renderer};
use ibgs_core::similarity::Similarity;

/// A renderer of the tiny demo, trained for a moment, and the demo.
fn trained() -> (Renderer, Dataset) {
    let dataset = dataset();
    let mut training = trainer(&dataset, &plain(200));
    run(&mut training, 200);
    (training.renderer().unwrap(), dataset)
}

/// Turned by 0.3 degrees and moved.
fn disturbed(camera: &Camera, by: DVec3) -> Camera {
    let rotation = DVec3::new(0.6, -0.7, 0.39).normalize() * 0.3_f64.to_radians();
    camera.changed(&CameraChange { rotation, translation: by, ..CameraChange::default() })
}

fn degrees(a: &Camera, b: &Camera) -> f64 {
    Similarity::IDENTITY.residual(a, b).0.to_degrees()
}

fn photo(image: &Rendered, color: impl Fn(f32) -> f32) -> Photo {
    let byte = |v: f32| (color(v).clamp(0.0, 1.0) * 255.0).round() as u8;
    let pixel = |c: &[f32]| [byte(c[0]), byte(c[1]), byte(c[2]), 255];
    Photo { width: image.width, height: image.height, rgba: image.rgb.chunks_exact(3).flat_map(pixel).collect() }
}

/// Where the photo is a render of the model, the error is that of the method.
#[test]
fn a_pose_is_found_again_in_a_photo_of_the_model() {
    let (renderer, dataset) = trained();
    let truth = dataset.views[dataset.test[0]].camera.resized(160, 120);
    let image = renderer.render(&truth).unwrap().base().unwrap();
    let length = truth.center().length();
    let given = disturbed(&truth, DVec3::new(0.004, -0.003, 0.005) * length);
    for (colors, as_seen) in [(Colors::Fixed, [1.0, 0.0]), (Colors::Fitted, [0.8, 0.06])] {
        let photo = photo(&image, |v| as_seen[0] * v + as_seen[1]);
        let found = fit_pose(&renderer, (&given, &photo), length, colors).unwrap();
        let [before, after] = [&given, &found].map(|camera| Similarity::IDENTITY.residual(camera, &truth));
        println!("{colors:?}: degrees and distance from {before:?} to {after:?}");
        assert!(after.0.to_degrees() < 0.05 && after.1 < 0.1 * before.1, "{colors:?}: {before:?} {after:?}");
        assert_eq!((found.focal, found.principal), (given.focal, given.principal));
    }
    // Nothing to fit to.
    let nothing = Photo { rgba: vec![0; 4 * truth.pixels()], ..photo(&image, |v| v) };
    assert_eq!(fit_pose(&renderer, (&given, &nothing), length, Colors::Fixed).unwrap(), given);
}

/// The photos are renders of the model, so that it knows them.
#[test]
fn held_out_cameras_that_are_turned_gain_from_a_fit_to_their_photos() {
    let (renderer, mut truth) = trained();
    for index in truth.test.clone() {
        let view = &mut truth.views[index];
        view.camera = view.camera.resized(160, 120);
        let image = renderer.render(&view.camera).unwrap().base().unwrap();
        view.photo = photo(&image, |v| v).into();
    }
    let mut turned = truth.clone();
    turned.test.iter().for_each(|&view| {
        let camera = &mut turned.views[view].camera;
        *camera = disturbed(camera, DVec3::ZERO);
    });
    let fitted = fitted_views(&renderer, &turned, &plain(200), &mut |_| {}).unwrap();
    assert_eq!(fitted.len(), truth.test.len());
    for (view, &index) in fitted.iter().zip(&truth.test) {
        let given = score_view(&renderer, &turned.views[index], None).unwrap().1.base.psnr;
        let off = degrees(&view.camera, &truth.views[index].camera);
        let psnr = view.scores.base.psnr;
        println!("{}: {given:.2} dB, fitted {psnr:.2}, gained {:.2}, {off:.3} degrees", view.name, view.gained);
        assert!(view.gained > 3.0 && (psnr - given - view.gained).abs() < 1e-6, "{view:?} {given}");
        assert!(off < 0.1, "{view:?} {off}");
    }
    // From where they belong they stay.
    let kept = fitted_views(&renderer, &truth, &plain(200), &mut |_| {}).unwrap();
    for (view, &index) in kept.iter().zip(&truth.test) {
        assert!(degrees(&view.camera, &truth.views[index].camera) < 0.02, "{view:?}");
    }
    let folder = tempfile::tempdir().unwrap();
    write_fitted(&fitted, &OutputFolder::at(folder.path()), 200).unwrap();
    let text = std::fs::read_to_string(folder.path().join(FITTED_POSES_FILE)).unwrap();
    assert!(text.contains("PSNR_fitted_pose") && !text.contains("\"PSNR\""), "{text}");
}
