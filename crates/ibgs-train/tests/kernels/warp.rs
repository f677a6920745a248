//! Warping: which sources see a point, and which texels are read.

use crate::common::surface;
use crate::gradients::assert_gradient;
use crate::gradients::surface::{assert_outputs, random_cotangents, warping};
use ibgs_core::sources::Warper;
use ibgs_reference::gpu::{scene_splats, source_view, view_of};
use ibgs_reference::random_scene::exact;
use ibgs_reference::relative_error;
use ibgs_reference::surface_scene::*;
use ibgs_reference::warp::{SOFT_REACH, Source};

/// Sources whose depths are off by up to five times what agrees, with their errors.
#[test]
fn sources_are_packed_as_far_as_confidence_reaches() {
    for (seed, k) in [(1, 4), (3, 8)] {
        let mut scene = wall(seed, k);
        for source in &mut scene.sources {
            source.reach = SOFT_REACH;
            source.photo.iter_mut().flatten().for_each(|v| *v = (*v * 255.0).round() / 255.0);
            // Within each row from 6 % too near to 6 % too far.
            let width = source.camera.width as usize;
            let off = |i: usize| 0.94 + 0.12 * (i % width) as f64 / width as f64;
            source.depth.iter_mut().enumerate().for_each(|(i, z)| *z = exact(*z * off(i)));
        }
        let v = random_cotangents(&scene, seed);
        let (geometry, warp) = scene.run();
        let truth = scene.grads(&geometry, &v);
        let ours = surface(&scene, &view_of(&scene, 0.5), warping(&scene), &v);
        assert_eq!(ours.source, warp.source, "wall {seed}: visible sources");
        let errors: Vec<_> = ours.error.iter().zip(&warp.error).filter(|(a, b)| a != b).collect();
        assert!(errors.len() < ours.error.len() / 200, "wall {seed}: errors differ: {errors:?}");
        assert!(errors.iter().all(|(a, b)| a.abs_diff(**b) == 1), "wall {seed}: {errors:?}");
        assert!([0, 2, 3, 14].iter().all(|step| warp.error.contains(step)), "wall {seed}: some agree, others do not");
        assert_outputs(&format!("wall {seed}"), &ours.outputs, &scene.outputs(), 2e-5);
        for name in TENSORS.into_iter().chain(["xy_pixels", "xy_pixels_abs"]) {
            assert_gradient(&format!("wall {seed} {name}"), ours.grad(name), grad(&truth, name), 1e-3);
        }
    }
}

/// Masked texels of the sources are not read: by forward and backward as in the twin, and their colours reach nothing.
#[test]
fn masked_texels_of_sources_are_not_read() {
    for (seed, k) in [(1, 4), (3, 8)] {
        let mut scene = wall(seed, k);
        let open = scene.outputs();
        for (m, source) in scene.sources.iter_mut().enumerate() {
            source.photo.iter_mut().flatten().for_each(|v| *v = (*v * 255.0).round() / 255.0);
            // Stripes, wide and narrow, and single texels; a landing may touch one with any of its corners.
            let width = source.camera.width as usize;
            let masked = |i: usize| (i % width + i / width + 3 * m) % 11 < 3 || (i * (2 * m + 3)).is_multiple_of(29);
            source.valid = (0..source.photo.len()).map(|i| !masked(i)).collect();
        }
        let v = random_cotangents(&scene, seed);
        let (geometry, warp) = scene.run();
        let truth = scene.grads(&geometry, &v);
        let masked = scene.outputs();
        assert!(
            relative_error(masked.warped.as_flattened(), open.warped.as_flattened()) > 0.1,
            "the mask hides little"
        );
        assert!(warp.source.iter().any(|source| *source >= 0), "the mask hides everything");
        let run = |scene: &Scene| surface(scene, &view_of(scene, 0.5), warping(scene), &v);
        let ours = run(&scene);
        assert_eq!(ours.source, warp.source, "masked wall {seed}: visible sources");
        assert_outputs(&format!("masked wall {seed}"), &ours.outputs, &masked, 2e-5);
        for name in TENSORS.into_iter().chain(["xy_pixels", "xy_pixels_abs"]) {
            assert_gradient(&format!("masked wall {seed} {name}"), ours.grad(name), grad(&truth, name), 1e-3);
        }
        for source in &mut scene.sources {
            let hidden = source.photo.iter_mut().zip(&source.valid).filter(|(_, valid)| !**valid);
            hidden.for_each(|(color, _)| *color = color.map(|v| 1.0 - v));
        }
        let other = run(&scene);
        assert!(ours.outputs == other.outputs && ours.grads == other.grads, "masked colours were read");
    }
}

/// Sources of a second dispatch, and between others that no pixel sees, count as those of the first.
#[test]
fn six_sources_are_warped_as_three() {
    let mut three = wall(3, 4);
    three.sources.iter_mut().flat_map(|source| &mut source.photo).flatten().for_each(|v| *v = exact(*v));
    let hidden = |source: &Source| Source { valid: vec![false; source.valid.len()], ..source.clone() };
    let places = [1, 4, 5];
    let sources = (0..6).map(|place| match places.iter().position(|p| *p == place) {
        Some(m) => three.sources[m].clone(),
        None => hidden(&three.sources[place % 3]),
    });
    let six = Scene { sources: sources.collect(), ..three.clone() };
    let v = random_cotangents(&three, 3);
    let run = |scene: &Scene| surface(scene, &view_of(scene, 0.5), warping(&three), &v);
    let (few, many) = (run(&three), run(&six));
    let place = |source: &i32| places.get(*source as usize).map_or(-1, |place| *place as i32);
    assert!(few.source.contains(&2), "all three are seen");
    assert_eq!(few.source.iter().map(place).collect::<Vec<_>>(), many.source);
    assert_eq!(few.most_visible, many.most_visible);
    assert!(few.outputs == many.outputs, "outputs");
    assert!(few.grads == many.grads, "gradients");
}

/// Masked texels are not read: a source that is masked all over is seen nowhere.
#[test]
fn masked_sources_are_not_seen() {
    let scene = wall(1, 4);
    let raster = ibgs_reference::gpu::rasterizer();
    let gpu = raster.gpu().clone();
    let mut sources: Vec<_> = scene.sources.iter().map(source_view).collect();
    let camera = scene.sources[0].camera;
    let blank = ibgs_core::dataset::Photo {
        width: camera.width,
        height: camera.height,
        rgba: vec![100; 4 * (camera.width * camera.height) as usize],
    };
    sources[0].photo = ibgs_core::sources::DevicePhoto::upload(&gpu, &blank).unwrap();
    let forward = raster.surface(&scene_splats(&scene), &view_of(&scene, 0.5)).unwrap();
    let warper = Warper::new(gpu.clone(), warping(&scene));
    let warped = warper.warp(&forward, &sources, warper.memory(&scene.camera).unwrap()).unwrap();
    let pixels = (scene.camera.width * scene.camera.height) as usize;
    let packed = gpu.read(&warped.seen.visible, pixels).unwrap();
    assert!(packed.iter().all(|word| word & 255 != 0) && packed.iter().any(|word| word & 255 == 1));
    assert!(gpu.read(&warped.colors, pixels).unwrap().iter().any(|v| *v != [0.0; 4]));
}
