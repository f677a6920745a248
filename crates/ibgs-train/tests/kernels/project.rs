//! The projection of Gaussians that stand out: degrees, extremes, values that are not finite.

use crate::common::gradients;
use half::f16;
use ibgs_core::gpu::device_descriptor;
use ibgs_core::raster::Rasterizer;
use ibgs_core::scene::{Gaussians, Harmonics, Splats};
use ibgs_reference::gpu::{assert_images_agree, device_of, gaussians, gpu, pixels, rasterizer, render};
use ibgs_reference::gpu::{background, view};
use ibgs_reference::random_scene::{Nasty, POISON, nasty_params, poison, random_camera, random_image, random_params};
use ibgs_reference::{self as reference, Tensor};

#[test]
fn lower_active_degrees_ignore_the_rest() {
    let p = random_params(200, 3, 11);
    let camera = random_camera(50, 40, 11);
    for degree in 0..3 {
        let twin = reference::render(&p, &camera, background(), degree);
        let ours = render(&p, &view(camera, degree as u32));
        assert_images_agree(&format!("active degree {degree} of 3"), &ours, &twin.image, 2e-5);
    }
}

#[test]
fn nasty_gaussians_stay_finite_and_leave_the_others_alone() {
    let camera = random_camera(48, 40, 14);
    for case in Nasty::ALL {
        let p = nasty_params(60, 2, 14, &camera, &[case]);
        let ours = render(&p, &view(camera, 2));
        assert!(ours.iter().all(|v| v.is_finite()), "{case:?}");
        let twin = reference::render(&p, &camera, background(), 2);
        assert_images_agree(&format!("{case:?}"), &ours, &twin.image, 1e-4);
        let g = gradients(&p, &view(camera, 2), &random_image(48, 40, -1.0, 1.0, 14));
        for name in Tensor::ALL {
            assert!(g.get(name).iter().all(|v| v.is_finite()), "{case:?}: gradient of {name:?}");
        }
    }
}

/// A Gaussian with a NaN or an infinity is not drawn, has no gradient, and changes nothing for the others.
#[test]
fn poisoned_gaussians_are_left_out() {
    let camera = random_camera(40, 32, 15);
    let p = random_params(40, 1, 15);
    let cotangent = random_image(40, 32, -1.0, 1.0, 15);
    for name in Tensor::ALL {
        let stride = p.get(name).len() / p.len();
        for value in POISON {
            let mut bad = p.clone();
            poison(&mut bad, name, 7 * stride, value);
            let twin = reference::render(&bad, &camera, background(), 1);
            let what = format!("{name:?} = {value}");
            assert_images_agree(&what, &render(&bad, &view(camera, 1)), &twin.image, 2e-5);
            let g = gradients(&bad, &view(camera, 1), &cotangent);
            for other in Tensor::ALL {
                assert!(g.get(other).iter().all(|v| v.is_finite()), "{what}: gradient of {other:?}");
            }
        }
    }
}

/// A device that binds some of the colours at a time gives the same image.
#[test]
fn colours_in_parts_change_nothing() {
    // Room for the lists, and for the colours of 2,730 Gaussians, of 5,461 in half precision.
    let small = device_of(|adapter| {
        let mut descriptor = device_descriptor(adapter);
        descriptor.required_limits.max_storage_buffer_binding_size = 512 << 10;
        descriptor
    });
    small.watch();
    let camera = random_camera(50, 40, 17);
    let p = gaussians(&random_params(6000, 3, 17));
    let view = view(camera, 3);
    for harmonics in [Harmonics::Full, Harmonics::Half] {
        let [all, parts] = [gpu(), small.clone()].map(|gpu| {
            let splats = Splats::upload_in(&p, &gpu, harmonics).unwrap();
            let image = Rasterizer::new(gpu.clone()).render(&splats, &view).unwrap();
            (gpu.read(&image, 3 * camera.pixels()).unwrap(), splats.download(&gpu).unwrap().sh)
        });
        assert!(all == parts, "{harmonics:?}");
        let p = Gaussians { sh: vec![0.0; p.sh.len()], ..p.clone() };
        let without = Splats::upload_in(&p, &small, harmonics).unwrap();
        let image = Rasterizer::new(small.clone()).render(&without, &view).unwrap();
        assert!(all.0 != small.read(&image, 3 * camera.pixels()).unwrap(), "{harmonics:?}: the colours are seen");
    }
    small.check().unwrap();
}

/// Coefficients that are halves give the image of the numbers that they stand for, in every stored and active degree, and one
/// within 1/255 of the exact one.
#[test]
fn halves_give_the_image_of_their_numbers() {
    let camera = random_camera(50, 40, 16);
    for stored in 0..=3 {
        let p = random_params(200, stored, 16);
        let splats = Splats::upload_in(&gaussians(&p), &gpu(), Harmonics::Half).unwrap();
        let mut rounded = p.clone();
        rounded.sh.iter_mut().for_each(|v| *v = f16::from_f64(*v).to_f64());
        assert_ne!(rounded.sh, p.sh);
        for active in 0..=stored {
            let view = view(camera, active as u32);
            let what = format!("degree {active} of {stored}");
            let ours = pixels(&rasterizer().render(&splats, &view).unwrap(), &camera);
            let twin = reference::render(&rounded, &camera, background(), active);
            assert_images_agree(&what, &ours, &twin.image, 2e-5);
            let exact = render(&p, &view);
            let most = ours.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(most < 1.0 / 255.0, "{what}: {most}");
        }
        for value in POISON {
            let mut bad = rounded.clone();
            poison(&mut bad, Tensor::Sh, 7 * 3 * p.sh_coefficients(), value);
            let splats = Splats::upload_in(&gaussians(&bad), &gpu(), Harmonics::Half).unwrap();
            let ours = pixels(&rasterizer().render(&splats, &view(camera, stored as u32)).unwrap(), &camera);
            let twin = reference::render(&bad, &camera, background(), stored);
            assert_images_agree(&format!("degree {stored}, {value}"), &ours, &twin.image, 2e-5);
        }
        let back = splats.download(&gpu()).unwrap();
        assert!(back.sh.iter().zip(&rounded.sh).all(|(a, b)| f64::from(*a) == *b), "degree {stored}: read back");
    }
}
