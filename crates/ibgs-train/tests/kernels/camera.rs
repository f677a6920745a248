//! Gradients by the cameras of target and sources.

use crate::common::{camera_gradient_of_image, surface};
use crate::gradients::surface::{random_cotangents, warping};
use ibgs_core::camera_change::CameraChange;
use ibgs_core::raster::RasterView;
use ibgs_reference::backward::rasterize_backward;
use ibgs_reference::camera_gradient::{camera_gradient, camera_project};
use ibgs_reference::gpu::view_of;
use ibgs_reference::random_scene::{POISON, poison, random_camera, random_image, random_params};
use ibgs_reference::surface_scene::*;
use ibgs_reference::warp::SOFT_REACH;
use ibgs_reference::{self as reference, Params, Tensor, relative_error};

/// Translation, rotation, focal lengths and principal point, each by its 2-norm; zero where the truth is.
fn assert_change(what: &str, ours: CameraChange, truth: CameraChange, tolerance: f64) {
    let (ours, truth) = (ours.to_array(), truth.to_array());
    let errors = [0..3, 3..6, 6..8, 8..10].map(|part| relative_error(&ours[part.clone()], &truth[part]));
    println!("{what}: {:?}", errors.map(|error| format!("{error:.1e}")));
    assert!(errors.iter().all(|error| *error <= tolerance), "{what}: {ours:?} against {truth:?}");
}

fn base_twin(p: &Params, view: &RasterView, cotangent: &[[f64; 3]]) -> CameraChange {
    let background = view.background.map(f64::from);
    let forward = reference::render(p, &view.camera, background, view.sh_degree as usize);
    let v = rasterize_backward(&view.camera, background, &forward, cotangent);
    camera_project(p, &view.camera, &forward, &v)
}

#[test]
fn the_base_follows_the_twin() {
    for (seed, (width, height)) in (20..).zip([(40, 30), (65, 47), (17, 90), (128, 96)]) {
        let degree = seed as usize % 4;
        let p = random_params(250, degree, seed);
        let cotangent = random_image(width, height, -1.0, 1.0, seed);
        let camera = random_camera(width, height, seed);
        let view = RasterView { background: [0.25, 0.5, 0.75], ..RasterView::new(camera, degree as u32) };
        let truth = base_twin(&p, &view, &cotangent);
        assert!(truth.to_array().iter().all(|v| *v != 0.0), "a number without gradient");
        let ours = camera_gradient_of_image(&p, &view, &cotangent);
        assert_change(&format!("seed {seed}, degree {degree}"), ours, truth, 1e-3);
        assert_eq!(camera_gradient_of_image(&p, &view, &cotangent), ours, "seed {seed}: bits");
    }
    let none = random_params(0, 0, 1);
    let view = RasterView::new(random_camera(16, 16, 1), 0);
    let ours = camera_gradient_of_image(&none, &view, &random_image(16, 16, -1.0, 1.0, 1));
    assert_eq!(ours, CameraChange::default(), "nothing in the scene");
}

#[test]
fn poisoned_gaussians_say_nothing_of_the_camera() {
    let view = RasterView::new(random_camera(40, 32, 15), 1);
    let cotangent = random_image(40, 32, -1.0, 1.0, 15);
    let p = random_params(40, 1, 15);
    for name in Tensor::ALL {
        let mut bad = p.clone();
        let stride = p.get(name).len() / p.len();
        POISON.iter().zip(3..).for_each(|(value, at)| poison(&mut bad, name, at * stride, *value));
        let ours = camera_gradient_of_image(&bad, &view, &cotangent);
        assert_change(&format!("{name:?}"), ours, base_twin(&bad, &view, &cotangent), 1e-3);
    }
}

/// Each output of the target view alone, and all together: of the target's camera and of each source's.
#[test]
fn surface_and_warping_follow_the_twin() {
    for (seed, k, reach, masked) in [(1, 4, 1.0, false), (3, 8, SOFT_REACH, true)] {
        let mut scene = wall(seed, k);
        for (m, source) in scene.sources.iter_mut().enumerate() {
            source.reach = reach;
            source.photo.iter_mut().flatten().for_each(|v| *v = (*v * 255.0).round() / 255.0);
            let is_masked = |i: usize| masked && (i * (2 * m + 3)).is_multiple_of(29);
            source.valid = (0..source.photo.len()).map(|i| !is_masked(i)).collect();
        }
        let all = random_cotangents(&scene, seed);
        let (geometry, _) = scene.run();
        for group in GROUPS {
            let v = only(&all, group);
            let (target, sources) =
                camera_gradient(&scene.params, &scene.camera, scene.background, &geometry, &scene.sources, &v);
            let ours = surface(&scene, &view_of(&scene, 0.5), warping(&scene), &v).cameras;
            assert_eq!(ours.len(), 1 + sources.len());
            for (camera, (ours, truth)) in ours.into_iter().zip(std::iter::once(target).chain(sources)).enumerate() {
                let what = format!("wall {seed} {group}, camera {camera}");
                let reaches = camera == 0 || matches!(group, "warped" | "cosine" | "all");
                assert_eq!(truth != CameraChange::default(), reaches, "{what}");
                // A turn of a source changes no cosine: what is left is rounding.
                let truth = if group == "cosine" && camera > 0 {
                    CameraChange { rotation: ours.rotation, ..truth }
                } else {
                    truth
                };
                assert_change(&what, ours, truth, 2e-3);
            }
        }
    }
}
