//! The cut-offs of the blending, and scenes made to break it.

use glam::{DMat3, DVec2, DVec3};
use ibgs_data::camera::Camera;

use ibgs_reference::backward::rasterize_backward;
use ibgs_reference::random_scene::{
    Nasty, POISON, exact, nasty_params, poison, random_camera, random_image, random_params,
};
use ibgs_reference::{MIN_ALPHA, MIN_TRANSMITTANCE, Params, Projected, Tensor, backward, project, rasterize, render};

const BLACK: [f64; 3] = [0.0; 3];

fn one_tile() -> Camera {
    Camera {
        width: 16,
        height: 16,
        focal: DVec2::splat(16.0),
        principal: DVec2::splat(8.0),
        view_from_world: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    }
}

/// A splat so flat that its falloff is 1 over the tile, unless `conic` says otherwise.
fn splat(depth: f64, opacity: f64) -> Projected {
    Projected {
        visible: true,
        xy: [8.0, 8.0],
        depth,
        conic: [1e-12, 0.0, 1e-12],
        opacity,
        color: [1.0, 0.5, 0.25],
        rect: [0, 0, 1, 1],
        radius: 100.0,
    }
}

#[test]
fn faint_parts_are_skipped() {
    for (opacity, seen) in [(MIN_ALPHA * 0.999, false), (MIN_ALPHA * 1.001, true)] {
        let forward = rasterize(vec![splat(1.0, opacity)], &one_tile(), BLACK, 0);
        assert_eq!(forward.last.iter().all(|l| *l == 1), seen);
        assert_eq!(forward.final_t.iter().all(|t| *t < 1.0), seen);
    }
}

#[test]
fn blending_stops_before_the_transmittance_falls_too_low() {
    // 0.99 twice would leave 1e-4 exactly and be kept or not by rounding, differently in single precision.
    let list = vec![splat(1.0, 1.0), splat(2.0, 0.98), splat(3.0, 0.9), splat(4.0, 0.1)];
    let forward = rasterize(list, &one_tile(), BLACK, 0);
    // The first two leave 0.01 and 2e-4, the third would leave 2e-5: it is not blended, and nothing behind it is, though the fourth would fit.
    assert!(forward.last.iter().all(|l| *l == 2));
    assert!(forward.final_t.iter().all(|t| (t - 2e-4).abs() < 1e-9 && *t > MIN_TRANSMITTANCE));
    let v = rasterize_backward(&one_tile(), BLACK, &forward, &[[1.0; 3]; 256]);
    assert!(v.opacity[1] != 0.0 && v.opacity[2] == 0.0 && v.opacity[3] == 0.0);
    assert!(v.color[3] == [0.0; 3]);
}

#[test]
fn a_clamped_alpha_is_a_constant() {
    let mut clamped = splat(1.0, 0.999);
    clamped.conic = [1e-5, 0.0, 1e-5];
    let forward = rasterize(vec![clamped], &one_tile(), BLACK, 0);
    assert!(forward.final_t.iter().all(|t| (t - 0.01).abs() < 1e-12));
    let v = rasterize_backward(&one_tile(), BLACK, &forward, &[[1.0; 3]; 256]);
    assert_eq!((v.opacity[0], v.conic[0], v.xy[0], v.xy_abs[0]), (0.0, [0.0; 3], [0.0; 2], [0.0; 2]));
    assert!((v.color[0][0] - 0.99 * 256.0).abs() < 1e-9);
}

#[test]
fn an_indefinite_conic_is_skipped() {
    let mut indefinite = splat(1.0, 0.5);
    indefinite.conic = [-1.0, 0.0, 1e-12];
    let forward = rasterize(vec![indefinite], &one_tile(), BLACK, 0);
    // Only the pixels of its own column see a power that is not positive.
    for (i, last) in forward.last.iter().enumerate() {
        assert_eq!(*last == 1, i % 16 == 8, "pixel {i}");
    }
}

#[test]
fn order_is_by_single_precision_depth_then_index() {
    let list = vec![splat(2.0, 0.5), splat(1.0 + 1e-12, 0.5), splat(1.0, 0.5), splat(0.5, 0.5)];
    let forward = rasterize(list, &one_tile(), BLACK, 0);
    assert_eq!(forward.order, vec![vec![3, 1, 2, 0]]);
}

#[test]
fn the_background_shows_through() {
    let background = [0.2, 0.4, 0.6];
    let empty = render(&Params::default(), &random_camera(20, 10, 1), background, 0);
    assert!(empty.image.iter().all(|c| *c == background));
    let half = rasterize(vec![splat(1.0, 0.5)], &one_tile(), background, 0);
    assert!((half.image[0][2] - (0.5 * 0.25 + 0.5 * 0.6)).abs() < 1e-9);
}

#[test]
fn a_gaussian_stays_within_its_tiles() {
    let mut camera = one_tile();
    camera.width = 48;
    let mut p = random_params(1, 0, 2);
    // Centred on pixel 7.5 of the first tile, standard deviation just over 2 pixels: radius 7.
    p.means[0] = [0.0, 0.0, 2.0];
    p.log_scales[0] = [0.25f64.ln(); 3].map(exact);
    let g = project(&p, &camera, 0)[0];
    assert_eq!((g.xy, g.radius, g.rect), ([7.5, 7.5], 7.0, [0, 0, 1, 1]));
    let forward = render(&p, &camera, BLACK, 0);
    assert_eq!(forward.order.iter().map(Vec::len).collect::<Vec<_>>(), [1, 0, 0]);
}

/// Renders and differentiates; everything must be finite. Returns image and gradients by the means.
fn finite_run(p: &Params, camera: &Camera, name: &str) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let v_image = random_image(camera.width, camera.height, -1.0, 1.0, 3);
    let forward = render(p, camera, [0.5; 3], p.sh_degree);
    assert!(forward.image.as_flattened().iter().all(|v| v.is_finite()), "{name}: image");
    let grads = backward(p, camera, [0.5; 3], &forward, &v_image);
    for tensor in Tensor::ALL {
        assert!(grads.get(tensor).iter().all(|v| v.is_finite()), "{name}: gradient by {tensor:?}");
    }
    (forward.image, grads.means)
}

#[test]
fn nasty_scenes_stay_finite() {
    let camera = random_camera(37, 21, 4);
    for case in Nasty::ALL {
        let p = nasty_params(6, 2, 4, &camera, &[case]);
        finite_run(&p, &camera, &format!("{case:?}"));
        let visible = project(&p, &camera, 2)[0].visible;
        match case {
            Nasty::BehindCamera | Nasty::AtCameraCenter | Nasty::InsideNearPlane | Nasty::ZeroRotation => {
                assert!(!visible, "{case:?} is visible")
            }
            Nasty::BeyondNearPlane | Nasty::ZeroScale | Nasty::Huge | Nasty::OffScreen => {
                assert!(visible, "{case:?} is not visible");
            }
            _ => {}
        }
    }
    finite_run(&nasty_params(20, 2, 5, &camera, &Nasty::ALL), &camera, "all at once");
}

#[test]
fn a_poisoned_gaussian_vanishes_and_harms_no_other() {
    let camera = random_camera(37, 21, 6);
    let p = random_params(6, 1, 6);
    let mut without = p.clone();
    without.opacity_logits[0] = -20.0;
    let (image, v_means) = finite_run(&without, &camera, "without");
    for tensor in Tensor::ALL {
        for value in POISON {
            if tensor == Tensor::OpacityLogits && value.is_infinite() || tensor == Tensor::LogScales && value < 0.0 {
                // An infinite logit is an opacity of 0 or 1 and exp(-inf) a scale of 0: extreme but valid.
                continue;
            }
            let mut poisoned = p.clone();
            poison(&mut poisoned, tensor, 0, value);
            let name = format!("{tensor:?} {value}");
            let (image_now, v_means_now) = finite_run(&poisoned, &camera, &name);
            assert!(!project(&poisoned, &camera, 1)[0].visible, "{name}");
            assert_eq!(image_now, image, "{name}: image");
            assert_eq!(v_means_now, v_means, "{name}: gradients");
            assert_eq!(v_means_now[0], [0.0; 3], "{name}: own gradient");
        }
    }
}
