//! The forward rasterizer against its twin.

use crate::common::{assert_images_agree, gradients, rasterizer, render, splats};
use crate::reference::random_scene::{Nasty, POISON, nasty_params, poison, random_camera, random_image, random_params};
use crate::reference::{self, Model, Params, Projected, Tensor};
use ibgs_core::raster::{Dropout, RasterView};
use ibgs_shaders::{NEAR_DEPTH, TILE};

fn view(camera: ibgs_core::camera::Camera, degree: u32) -> RasterView {
    RasterView { background: [0.1, 0.5, 0.9], ..RasterView::new(camera, degree) }
}

fn background() -> [f64; 3] {
    [0.1f32, 0.5, 0.9].map(f64::from)
}

#[test]
fn random_scenes_of_every_size_and_degree() {
    let sizes = [(1, 1), (15, 7), (16, 16), (33, 17), (64, 48), (127, 95), (128, 128)];
    for (seed, (width, height)) in (0..).zip(sizes) {
        let degree = seed as usize % 4;
        let p = random_params(400, degree, seed);
        let camera = random_camera(width, height, seed);
        let twin = reference::render(&p, &camera, background(), degree);
        let ours = render(&p, &view(camera, degree as u32));
        assert_images_agree(&format!("{width} x {height}, degree {degree}"), &ours, &twin.image, 2e-5);
    }
}

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

/// Without held ratios the tiles change nothing at all.
#[test]
fn tiles_cut_nothing() {
    let p = random_params(300, 2, 12);
    let camera = random_camera(90, 70, 12);
    let twin = reference::render_as(&p, &camera, background(), 2, Model::Ideal);
    let free = RasterView { tangent_limit: 1e6, ..view(camera, 2) };
    assert_images_agree("no box", &render(&p, &free), &twin.image, 2e-5);
}

/// Least -log(alpha / opacity) over the pixel centres of a tile and what lies between them.
fn least_falloff(tile: [u32; 2], p: &Projected) -> f64 {
    let lo = [0, 1].map(|i| f64::from(tile[i] * TILE) - p.xy[i]);
    let hi = lo.map(|lo| lo + f64::from(TILE - 1));
    if (0..2).all(|i| lo[i] <= 0.0 && hi[i] >= 0.0) {
        return 0.0;
    }
    let [a, b, c] = p.conic;
    let falloff = |x: f64, y: f64| 0.5 * (a * x * x + 2.0 * b * x * y + c * y * y);
    // It is convex, so it is least on the rim, and on each side where its derivative along the side is zero or at an end.
    let columns = [lo[0], hi[0]].map(|x| falloff(x, (-b * x / c).clamp(lo[1], hi[1])));
    let rows = [lo[1], hi[1]].map(|y| falloff((-b * y / a).clamp(lo[0], hi[0]), y));
    columns.into_iter().chain(rows).fold(f64::INFINITY, f64::min)
}

/// The lists have every tile of a Gaussian's box where its outline, alpha = 1/255, reaches, and no other: also for thin, huge
/// and faint Gaussians.
#[test]
fn tile_lists_follow_the_outline() {
    for seed in 0..6 {
        let mut p = random_params(400, 0, 40 + seed);
        for (i, scales) in p.log_scales.iter_mut().enumerate() {
            match i % 4 {
                0 => *scales = [-6.0, 0.5, -6.0],
                1 => *scales = [0.3, 0.1, -0.2],
                _ => {}
            }
        }
        for opacity in p.opacity_logits.iter_mut().step_by(7) {
            *opacity -= 5.0;
        }
        let camera = random_camera(310, 230, 40 + seed);
        let counted = rasterizer().count_intersections(&splats(&p), &view(camera, 0)).unwrap();
        // Rounding may decide only what lies within a thousandth of the outline, which is drawn a hundredth too wide.
        let (mut least, mut most) = (0, 0);
        for splat in reference::project(&p, &camera, 0).iter().filter(|splat| splat.visible) {
            let cut = (255.0 * splat.opacity).ln() + 0.01;
            let [x0, y0, x1, y1] = splat.rect;
            for tile in (y0..y1).flat_map(|y| (x0..x1).map(move |x| [x, y])) {
                let falloff = least_falloff(tile, splat);
                least += u64::from(falloff < cut - 1e-3);
                most += u64::from(falloff < cut + 1e-3);
            }
        }
        println!("{counted} intersections, from {least} to {most}");
        assert!((least..=most).contains(&counted), "{counted} intersections, from {least} to {most}");
        assert!(least > 1000 && most - least < 20, "from {least} to {most}");
    }
}

#[test]
fn no_gaussians_and_no_visible_gaussians_leave_the_background() {
    let camera = random_camera(20, 13, 13);
    let empty = Params { sh_degree: 1, ..Params::default() };
    let mut hidden = random_params(5, 1, 13);
    for (i, mean) in hidden.means.iter_mut().enumerate() {
        let world = camera.center() - camera.forward() * (1.0 + i as f64);
        *mean = world.to_array();
    }
    for p in [empty, hidden] {
        let image = render(&p, &view(camera, 1));
        for pixel in image.chunks_exact(3) {
            assert_eq!(pixel, background(), "{} Gaussians", p.len());
        }
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

/// Values that lie exactly on a threshold: opacity 1/255, alpha clamped at 0.99, the largest depth that is culled, a mean on a tile border.
#[test]
fn thresholds_fall_the_same_way() {
    let mut camera = random_camera(32, 32, 16);
    camera.view_from_world = glam::DMat3::IDENTITY;
    camera.translation = glam::DVec3::ZERO;
    camera.focal = glam::DVec2::splat(32.0);
    camera.principal = glam::DVec2::splat(16.5);
    let mut p = random_params(4, 0, 16);
    let logit = |o: f64| f64::from((o / (1.0 - o)).ln() as f32);
    p.means = vec![[0.0, 0.0, f64::from(NEAR_DEPTH.next_down())], [0.0, 0.0, 2.0], [-0.5, -0.5, 2.0], [0.5, 0.5, 2.0]];
    p.opacity_logits = vec![5.0, logit(0.99), logit(1.0 / 255.0 + 1e-6), logit(1.0 / 255.0 - 1e-6)];
    p.log_scales = vec![[-3.0; 3]; 4];
    let twin = reference::render(&p, &camera, [0.0; 3], 0);
    let ours = render(&p, &RasterView::new(camera, 0));
    assert_images_agree("thresholds", &ours, &twin.image, 2e-5);
}

/// Gaussians that dropout leaves out might as well not be there: the same image and the same gradients, bit for bit.
#[test]
fn dropout_equals_a_smaller_model() {
    let camera = random_camera(70, 50, 17);
    let p = random_params(500, 2, 17);
    let cotangent = random_image(70, 50, -1.0, 1.0, 17);
    let dropout = Dropout::new(0.3, 5, 1234);
    let kept: Vec<usize> = (0..p.len()).filter(|&i| !dropout.drops(i as u32)).collect();
    assert!((300..400).contains(&kept.len()), "{} of 500 are left", kept.len());
    let smaller = Params {
        means: kept.iter().map(|&i| p.means[i]).collect(),
        rotations: kept.iter().map(|&i| p.rotations[i]).collect(),
        log_scales: kept.iter().map(|&i| p.log_scales[i]).collect(),
        opacity_logits: kept.iter().map(|&i| p.opacity_logits[i]).collect(),
        sh: kept.iter().flat_map(|&i| p.sh_of(i).to_vec()).collect(),
        sh_degree: p.sh_degree,
        ..Params::default()
    };
    let with = RasterView { dropout, ..view(camera, 2) };
    let image = render(&p, &with);
    assert_eq!(image, render(&smaller, &view(camera, 2)));
    assert_ne!(image, render(&p, &view(camera, 2)));
    let (ours, truth) = (gradients(&p, &with, &cotangent), gradients(&smaller, &view(camera, 2), &cotangent));
    for name in Tensor::ALL {
        let (all, few) = (ours.get(name), truth.get(name));
        let stride = all.len() / p.len();
        assert!(few.iter().any(|v| *v != 0.0), "{name:?}: nothing to compare");
        let mut rows = few.chunks_exact(stride);
        for (i, row) in all.chunks_exact(stride).enumerate() {
            match dropout.drops(i as u32) {
                true => assert!(row.iter().all(|v| *v == 0.0), "{name:?} of {i}, which is left out"),
                false => assert_eq!(Some(row), rows.next(), "{name:?} of {i}"),
            }
        }
    }
}
