//! Vector-Jacobian products under burn's autodiff against the twin and the golden data.

mod golden_final;
mod slice;
pub(crate) mod surface;
mod whole_loss;

use crate::common::gradients;
use ibgs_core::raster::RasterView;
use ibgs_reference::golden::{load_dump, load_gradients};
use ibgs_reference::gpu::{assert_images_agree, pixels, rasterizer, render, splats};
use ibgs_reference::random_scene::{random_camera, random_image, random_params};
use ibgs_reference::{self as reference, Model, Tensor, psnr, relative_error};

/// Relative error by the 2-norm; exactly zero where the truth is all zero, and never zero where it is not.
pub(crate) fn assert_gradient(what: &str, ours: &[f64], truth: &[f64], tolerance: f64) {
    if truth.iter().all(|v| *v == 0.0) {
        assert!(ours.iter().all(|v| *v == 0.0), "{what}: must be exactly zero");
        return;
    }
    assert!(ours.iter().any(|v| *v != 0.0), "{what}: must not be zero");
    let error = relative_error(ours, truth);
    println!("{what}: {error:.1e}");
    assert!(error <= tolerance, "{what}: relative error {error:e}");
}

#[test]
fn random_scenes_follow_the_twin() {
    for (seed, (width, height)) in (20..).zip([(40, 30), (65, 47), (17, 90), (128, 96)]) {
        let degree = seed as usize % 4;
        let p = random_params(250, degree, seed);
        let camera = random_camera(width, height, seed);
        let cotangent = random_image(width, height, -1.0, 1.0, seed);
        let background = [0.25, 0.5, 0.75];
        let forward = reference::render(&p, &camera, background, degree);
        let twin = reference::backward(&p, &camera, background, &forward, &cotangent);
        let view = RasterView { background: background.map(|v| v as f32), ..RasterView::new(camera, degree as u32) };
        let ours = gradients(&p, &view, &cotangent);
        for name in Tensor::ALL {
            assert_gradient(&format!("seed {seed} {name:?}"), ours.get(name), twin.get(name), 1e-3);
        }
        assert_gradient(&format!("seed {seed} xy"), &ours.screen_pair(0), twin.xy.as_flattened(), 1e-3);
        assert_gradient(&format!("seed {seed} |xy|"), &ours.screen_pair(2), twin.xy_abs.as_flattened(), 1e-3);
    }
}

#[test]
fn inactive_coefficients_have_no_gradient() {
    let p = random_params(50, 3, 31);
    let camera = random_camera(40, 30, 31);
    let ours = gradients(&p, &RasterView::new(camera, 1), &random_image(40, 30, -1.0, 1.0, 31));
    for row in ours.get(Tensor::Sh).chunks_exact(48) {
        assert!(row[12..].iter().all(|v| *v == 0.0));
    }
    assert!(ours.get(Tensor::Sh).iter().any(|v| *v != 0.0));
}

/// The golden gradients know neither boxes nor held ratios, so neither do we here.
#[test]
fn golden_base_gradients() {
    for file in ["gradients_k2_m2.npz", "gradients_k4_m3.npz", "gradients_k6_m4.npz"] {
        let golden = load_gradients(file);
        let p = &golden.params;
        let view = RasterView { tangent_limit: 1e6, ..RasterView::new(golden.cameras[0], p.sh_degree as u32) };
        assert_images_agree(file, &render(p, &view), &golden.out_base, 2e-5);
        let ours = gradients(p, &view, &golden.cotangent_base);
        for tensor in Tensor::ALL {
            let name = tensor.name();
            assert_gradient(&format!("{file} {name}"), ours.get(tensor), golden.grad("base", name), 1e-3);
        }
        let xy = golden.grad("base", "xy_pixels");
        assert_gradient(&format!("{file} xy_pixels"), &ours.screen_pair(0), xy, 1e-3);
        let xy_abs = golden.grad("base", "xy_pixels_abs");
        assert_gradient(&format!("{file} xy_pixels_abs"), &ours.screen_pair(2), xy_abs, 1e-3);
    }
}

#[test]
fn a_published_model_renders_its_base_image_and_has_the_twins_gradients() {
    let test = "gradients::a_published_model_renders_its_base_image_and_has_the_twins_gradients";
    let Some((golden, cloud)) = load_dump(test) else { return };
    let p = &cloud.params;
    let camera = golden.camera;
    let view = RasterView { box_sigma: 3.0, ..RasterView::new(camera, 2) };
    let ours = render(p, &view);
    let db = psnr(&ours, golden.base.as_flattened());
    println!("base image: {db:.1} dB");
    assert!(db >= 95.0, "base image: {db:.1} dB");
    let forward = reference::render_as(p, &camera, [0.0; 3], 2, Model::Boxed);
    assert_images_agree("published model", &ours, &forward.image, 2e-4);
    for seed in 0..2 {
        let cotangent = random_image(camera.width, camera.height, -1.0, 1.0, seed);
        let twin = reference::backward(p, &camera, [0.0; 3], &forward, &cotangent);
        let ours = gradients(p, &view, &cotangent);
        for name in Tensor::ALL {
            assert_gradient(&format!("published model {name:?}"), ours.get(name), twin.get(name), 2e-3);
        }
        assert_gradient("published model xy", &ours.screen_pair(0), twin.xy.as_flattened(), 2e-3);
        assert_gradient("published model |xy|", &ours.screen_pair(2), twin.xy_abs.as_flattened(), 2e-3);
    }
}

/// A photo of ordinary size, 540 pixels wide: pixel coordinates are large, so float32 has less left for the offsets.
#[test]
fn a_published_model_at_full_size_follows_the_twin() {
    let test = "gradients::a_published_model_at_full_size_follows_the_twin";
    let Some((golden, cloud)) = load_dump(test) else { return };
    let camera = golden.camera.resized(540, 960);
    let twin = reference::render(&cloud.params, &camera, [0.0; 3], 2);
    let ours = render(&cloud.params, &RasterView::new(camera, 2));
    assert_images_agree("published model at 540 x 960", &ours, &twin.image, 2e-4);
}

/// The same input gives the same bits, forward and backward, whatever ran before.
#[test]
fn results_repeat_bit_for_bit() {
    let p = random_params(3000, 2, 41);
    let camera = random_camera(100, 80, 41);
    let view = RasterView::new(camera, 2);
    let cotangent = random_image(100, 80, -1.0, 1.0, 41);
    let first = (render(&p, &view), gradients(&p, &view, &cotangent));
    for _ in 0..3 {
        let again = (render(&p, &view), gradients(&p, &view, &cotangent));
        assert!(first.0 == again.0, "image");
        for name in Tensor::ALL {
            assert!(first.1.get(name) == again.1.get(name), "{name:?}");
        }
        assert!(first.1.screen == again.1.screen, "screen");
    }
}

/// A pass with too little room is noticed and repeated with enough.
#[test]
fn too_many_intersections_grow_the_room() {
    let mut p = random_params(3000, 0, 42);
    p.log_scales = vec![[0.5; 3]; 3000];
    let camera = random_camera(160, 120, 42);
    let view = RasterView::new(camera, 0);
    let raster = rasterizer();
    let before = raster.capacity();
    let image = pixels(&raster.render(&splats(&p), &view).unwrap(), &view.camera);
    assert!(raster.capacity() > before, "{} intersections fit anyway", raster.capacity());
    let twin = reference::render(&p, &camera, [0.0; 3], 0);
    assert_images_agree("many intersections", &image, &twin.image, 2e-5);
}
