//! The projection of Gaussians that stand out: degrees, extremes, values that are not finite.

use super::rasterize::{background, view};
use crate::common::{assert_images_agree, gradients, render};
use crate::reference::random_scene::{Nasty, POISON, nasty_params, poison, random_camera, random_image, random_params};
use crate::reference::{self, Tensor};

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
