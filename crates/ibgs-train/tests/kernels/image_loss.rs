//! The L1 + SSIM loss against its twin, forward and backward.

use crate::common::values;
use burn::tensor::{Tensor, TensorData};
use ibgs_core::dataset::Photo;
use ibgs_core::sources::{DevicePhoto, Outside};
use ibgs_reference::gpu::gpu;
use ibgs_reference::image_loss;
use ibgs_reference::random_scene::random_image;
use ibgs_reference::relative_error;
use ibgs_train::loss::ImageLoss;
use ibgs_train::tensor::device;

type Image = Vec<[f64; 3]>;

fn photo(target: &[[f64; 3]], width: u32, height: u32, alpha: impl Fn(usize) -> u8) -> Photo {
    let texel = |(i, p): (usize, &[f64; 3])| {
        let [r, g, b] = p.map(|v| (v * 255.0).round() as u8);
        [r, g, b, alpha(i)]
    };
    Photo { width, height, rgba: target.iter().enumerate().flat_map(texel).collect() }
}

/// Loss and gradient on the GPU; the upstream gradient is 3.
fn on_gpu(image: &Image, photo: &Photo, lambda: f64) -> (f64, Vec<f64>) {
    on_gpu_with(image, photo, lambda, Outside::Unknown)
}

fn on_gpu_with(image: &Image, photo: &Photo, lambda: f64, outside: Outside) -> (f64, Vec<f64>) {
    let gpu = gpu();
    let mut target = DevicePhoto::upload(&gpu, photo).unwrap();
    target.outside = outside;
    let flat: Vec<f32> = image.as_flattened().iter().map(|v| *v as f32).collect();
    let shape = [photo.height as usize, photo.width as usize, 3];
    let leaf = Tensor::<3>::from_data(TensorData::new(flat, shape), device(&gpu).unwrap()).autodiff().require_grad();
    let loss = ImageLoss::new(gpu.clone(), lambda as f32);
    let (value, _scratch) = loss.tracked(leaf.clone(), &target).unwrap();
    let mut grads = (value.clone() * 3.0).backward();
    let gradient = leaf.grad_remove(&mut grads).unwrap();
    (values(value.inner())[0], values(gradient))
}

fn quantised(image: Image) -> Image {
    image.into_iter().map(|p| p.map(|v| (v * 255.0).round() / 255.0)).collect()
}

fn check(what: &str, image: &Image, target: &Image, width: u32, height: u32) {
    for lambda in [0.0, 0.2, 1.0] {
        let (loss, gradient) = on_gpu(image, &photo(target, width, height, |_| 255), lambda);
        let (w, h) = (width as usize, height as usize);
        let expected = image_loss::image_loss(image, target, w, h, lambda);
        assert!(
            (loss - expected).abs() <= 2e-6 + 1e-5 * expected,
            "{what}, lambda {lambda}: {loss} against {expected}"
        );
        let twin: Vec<f64> = image_loss::image_loss_backward(image, target, w, h, lambda)
            .as_flattened()
            .iter()
            .map(|v| 3.0 * v)
            .collect();
        let error = relative_error(&gradient, &twin);
        println!("{what}, lambda {lambda}: gradient error {error:.1e}");
        assert!(error <= 1e-3, "{what}, lambda {lambda}: gradient error {error:e}");
        assert!(twin.iter().any(|v| *v != 0.0) && gradient.iter().any(|v| *v != 0.0), "{what}: a gradient there is");
    }
}

#[test]
fn loss_and_gradient_follow_the_twin_at_every_size() {
    for (width, height) in [(1, 1), (5, 3), (16, 16), (17, 31), (60, 41), (128, 96)] {
        let image =
            random_image(width, height, -0.2, 1.2, 1).into_iter().map(|p| p.map(|v| f64::from(v as f32))).collect();
        let target = quantised(random_image(width, height, 0.0, 1.0, 2));
        check(&format!("{width} x {height}"), &image, &target, width, height);
    }
}

/// Flat bright pictures are where the windowed variance cancels.
#[test]
fn nearly_flat_pictures_keep_their_precision() {
    let (width, height) = (48, 40);
    let image =
        random_image(width, height, 0.895, 0.9, 3).into_iter().map(|p| p.map(|v| f64::from(v as f32))).collect();
    let target = quantised(random_image(width, height, 0.89, 0.91, 4));
    check("flat", &image, &target, width, height);
}

#[test]
fn masked_pixels_have_no_gradient_and_no_influence() {
    let (width, height) = (40, 24);
    let image: Image =
        random_image(width, height, 0.0, 1.0, 5).into_iter().map(|p| p.map(|v| f64::from(v as f32))).collect();
    let target = quantised(random_image(width, height, 0.0, 1.0, 6));
    let masked = |i: usize| i % 40 < 12;
    let alpha = |i: usize| if masked(i) { 0 } else { 255 };
    let (loss, gradient) = on_gpu(&image, &photo(&target, width, height, alpha), 0.2);
    // The twin sees the image's own value where the photo is masked.
    let filled: Image = (0..target.len()).map(|i| if masked(i) { image[i] } else { target[i] }).collect();
    let expected = image_loss::image_loss(&image, &filled, width as usize, height as usize, 0.2);
    assert!((loss - expected).abs() < 1e-5, "{loss} against {expected}");
    let other: Image = (0..target.len()).map(|i| if masked(i) { [0.123; 3] } else { target[i] }).collect();
    let (same, _) = on_gpu(&image, &photo(&other, width, height, alpha), 0.2);
    assert_eq!(loss, same, "what lies under the mask does not matter");
    let twin = image_loss::image_loss_backward(&image, &filled, width as usize, height as usize, 0.2);
    for (i, v) in gradient.chunks_exact(3).enumerate() {
        if masked(i) {
            assert_eq!(v, [0.0; 3], "pixel {i}");
        }
    }
    let visible = |v: &[f64]| -> Vec<f64> {
        v.chunks_exact(3).enumerate().filter(|(i, _)| !masked(*i)).flat_map(|(_, p)| p.to_vec()).collect()
    };
    let tripled: Vec<f64> = twin.as_flattened().iter().map(|v| 3.0 * v).collect();
    let error = relative_error(&visible(&gradient), &visible(&tripled));
    assert!(error <= 1e-3, "gradient error {error:e}");
}

/// Alpha from 1, nothing of the object, to 255, and no photo at 0.
#[test]
fn an_object_lies_over_the_background() {
    let background = [0.9f32, 0.0, 0.35];
    for (width, height) in [(1, 1), (17, 31), (60, 41)] {
        let pixels = (width * height) as usize;
        let image: Image =
            random_image(width, height, 0.0, 1.0, 7).into_iter().map(|p| p.map(|v| f64::from(v as f32))).collect();
        let target = quantised(random_image(width, height, 0.0, 1.0, 8));
        let alpha = |i: usize| [1, 1, 255, 2, 254, 127, 128, 0][i / 3 % 8];
        let cover: Vec<f64> = (0..pixels).map(|i| (f64::from(alpha(i)) - 1.0).max(0.0) / 254.0).collect();
        let mut shown = image_loss::over(&target, &cover, background.map(f64::from));
        // Where there is no photo the twin sees the image's own value.
        (0..pixels).filter(|&i| alpha(i) == 0).for_each(|i| shown[i] = image[i]);
        let (w, h) = (width as usize, height as usize);
        let outside = Outside::Background(background);
        for lambda in [0.0, 0.2, 1.0] {
            let (loss, gradient) = on_gpu_with(&image, &photo(&target, width, height, alpha), lambda, outside);
            let expected = image_loss::image_loss(&image, &shown, w, h, lambda);
            assert!((loss - expected).abs() <= 2e-6 + 1e-5 * expected, "{lambda}: {loss} against {expected}");
            let mut twin = image_loss::image_loss_backward(&image, &shown, w, h, lambda);
            (0..pixels).filter(|&i| alpha(i) == 0).for_each(|i| twin[i] = [0.0; 3]);
            let twin: Vec<f64> = twin.as_flattened().iter().map(|v| 3.0 * v).collect();
            let error = relative_error(&gradient, &twin);
            println!("{width} x {height}, lambda {lambda}: gradient error {error:.1e}");
            assert!(error <= 1e-3 && twin.iter().any(|v| *v != 0.0), "{width} x {height}, {lambda}: {error:e}");
            // What lies under an empty pixel does not matter.
            let other: Image = (0..pixels).map(|i| if alpha(i) < 2 { [0.1; 3] } else { target[i] }).collect();
            let again = on_gpu_with(&image, &photo(&other, width, height, alpha), lambda, outside);
            assert_eq!(again, (loss, gradient));
        }
    }
}

/// What looks as the background does where there is nothing costs nothing in L1, and pulls nowhere in SSIM.
#[test]
fn emptiness_that_looks_like_the_background_is_no_error() {
    for level in [0.0f32, 0.5, 1.0] {
        let image = vec![[f64::from(level); 3]; 24 * 20];
        let photo = photo(&vec![[0.3; 3]; 24 * 20], 24, 20, |_| 1);
        let (loss, _) = on_gpu_with(&image, &photo, 0.2, Outside::Background([level; 3]));
        assert!(loss.abs() < 1e-6, "{level}: {loss}");
        let (black, gradient) = on_gpu_with(&image, &photo, 0.2, Outside::Background([1.0 - level; 3]));
        let differs = level != 0.5;
        assert_eq!(black > 0.3, differs, "{level}: {black}");
        assert!(!differs || gradient.iter().all(|v| *v != 0.0), "every pixel is pulled");
    }
}
