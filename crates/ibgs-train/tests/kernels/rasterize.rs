//! The forward rasterizer against its twin.

use crate::common::{gradients, surface};
use crate::gradients::surface::warping;
use ibgs_core::raster::{Dropout, RasterView, Rasterizer, Room};
use ibgs_reference::geometry_backward::Cotangents;
use ibgs_reference::gpu::view_of;
use ibgs_reference::gpu::{assert_images_agree, background, render, scene_splats, view};
use ibgs_reference::random_scene::{random_camera, random_image, random_params};
use ibgs_reference::surface_scene::wall;
use ibgs_reference::{self as reference, Params, Tensor, relative_error};
use ibgs_shaders::NEAR_DEPTH;

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

/// The depth-only pass gives the very same depths as the full one.
#[test]
fn depth_maps_are_the_median_depths() {
    for (seed, k) in [(1, 4), (2, 2), (3, 8)] {
        let scene = wall(seed, k);
        let view = view_of(&scene, 0.5);
        let pixels = (scene.camera.width * scene.camera.height) as usize;
        let full = surface(&scene, &view, warping(&scene), &Cotangents::zeros(pixels, scene.sources.len()));
        let raster = Rasterizer::new(ibgs_reference::gpu::gpu());
        let map = raster.depth_map(&scene_splats(&scene), &view, Room::Checked).unwrap();
        let alone = raster.gpu().read(&map, pixels).unwrap();
        let error = relative_error(&alone.iter().map(|v| f64::from(*v)).collect::<Vec<_>>(), &full.outputs.depth);
        println!("wall {seed}: {error:.1e}");
        assert!(error < 1e-6, "wall {seed}: {error:e}");
    }
}
