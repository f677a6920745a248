//! The twins against the golden data.

use ibgs_data::camera::Camera;

use ibgs_reference::golden::{load_dump, load_gradients};
use ibgs_reference::{Forward, Model, Params, Tensor, backward, psnr, relative_error, render_as};

/// The golden gradients know neither tiles nor held ratios; the base image of the dump knows both.
fn render_ideal(p: &Params, camera: &Camera) -> Forward {
    render_as(p, camera, [0.0; 3], p.sh_degree, Model::Ideal)
}

#[test]
fn base_gradients_agree_with_automatic_differentiation() {
    for file in ["gradients_k2_m2.npz", "gradients_k4_m3.npz", "gradients_k6_m4.npz"] {
        let golden = load_gradients(file);
        let (p, camera) = (&golden.params, &golden.cameras[0]);
        let forward = render_ideal(p, camera);
        let error = relative_error(forward.image.as_flattened(), golden.out_base.as_flattened());
        println!("{file} out/base: {error:.1e}");
        assert!(error < 1e-9, "{file} out/base: relative error {error:e}");

        let g = backward(p, camera, [0.0; 3], &forward, &golden.cotangent_base);
        let pairs = [("xy_pixels", g.xy.as_flattened()), ("xy_pixels_abs", g.xy_abs.as_flattened())];
        for (name, ours) in Tensor::ALL.map(|tensor| (tensor.name(), g.get(tensor))).into_iter().chain(pairs) {
            let truth = golden.grad("base", name);
            assert!(truth.iter().any(|v| *v != 0.0), "{file} {name}: nothing to compare");
            let error = relative_error(ours, truth);
            println!("{file} grad/base/{name}: {error:.1e}");
            assert!(error < 1e-9, "{file} grad/base/{name}: relative error {error:e}");
        }
        for name in ["normal", "offset"] {
            assert!(golden.grad("base", name).iter().all(|v| *v == 0.0), "the base colour has no plane");
        }
    }
}

/// A Gaussian that no pixel sees has a gradient of exactly zero, in the twin as in the golden data.
#[test]
fn gradients_are_zero_at_the_same_gaussians() {
    let golden = load_gradients("gradients_k4_m3.npz");
    let (p, camera) = (&golden.params, &golden.cameras[0]);
    let forward = render_ideal(p, camera);
    let g = backward(p, camera, [0.0; 3], &forward, &golden.cotangent_base);
    let truth = golden.grad("base", "opacity_logit");
    for (i, (ours, truth)) in g.opacity_logits.iter().zip(truth).enumerate() {
        assert_eq!(*ours == 0.0, *truth == 0.0, "Gaussian {i}: {ours} against {truth}");
    }
}

#[test]
fn the_published_model_renders_the_same_base_image() {
    let test = "reference_checks::golden::the_published_model_renders_the_same_base_image";
    let Some((golden, cloud)) = load_dump(test) else { return };
    assert_eq!(cloud.params.len(), 29_883);
    assert_eq!(cloud.params.sh_degree, 2);
    assert_eq!(golden.source_cameras.len(), 4);
    let forward = render_as(&cloud.params, &golden.camera, [0.0; 3], 2, Model::Boxed);
    let db = psnr(forward.image.as_flattened(), golden.base.as_flattened());
    println!("base image: {db:.1} dB");
    assert!(db > 110.0, "base image: {db:.1} dB");
}

/// How far the published boxes and the held ratios move the golden scenes: what a kernel may differ from them by.
#[test]
fn boxes_and_held_ratios_move_the_golden_gradients_little() {
    for file in ["gradients_k2_m2.npz", "gradients_k4_m3.npz", "gradients_k6_m4.npz"] {
        let golden = load_gradients(file);
        let (p, camera) = (&golden.params, &golden.cameras[0]);
        let forward = render_as(p, camera, [0.0; 3], p.sh_degree, Model::Boxed);
        let g = backward(p, camera, [0.0; 3], &forward, &golden.cotangent_base);
        let image = relative_error(forward.image.as_flattened(), golden.out_base.as_flattened());
        println!("{file}: image {image:.1e}");
        assert!((1e-5..3e-3).contains(&image), "{file}: image {image:e}");
        for (name, ours) in Tensor::ALL.map(|tensor| (tensor.name(), g.get(tensor))) {
            let error = relative_error(ours, golden.grad("base", name));
            println!("{file}: tiled against ideal {name} {error:.1e}");
            assert!(error < 0.1, "{file} {name}: {error:e}");
        }
    }
}
