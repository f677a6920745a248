//! Median buffers, normal map and warping, forward and backward, against the twins and the golden data.

use super::assert_gradient;
use crate::common::surface;
use ibgs_core::raster::RasterView;
use ibgs_core::sources::WarpOptions;
use ibgs_reference::golden::{Golden, load_dump, load_gradients};
use ibgs_reference::gpu::view_of;
use ibgs_reference::random_scene::random_image;
use ibgs_reference::surface_scene::*;
use ibgs_reference::warp::Source;
use ibgs_reference::{Model, geometry_backward::Cotangents, psnr, relative_error};

pub(crate) fn warping(scene: &Scene) -> WarpOptions {
    let reach = scene.sources.first().map_or(1.0, |source| source.reach as f32);
    WarpOptions { visible: scene.sources.len() as u32, reach, ..WarpOptions::default() }
}

pub(crate) fn random_cotangents(scene: &Scene, seed: u64) -> Cotangents {
    let image = |salt: u64| random_image(scene.camera.width, scene.camera.height, -1.0, 1.0, 100 * seed + salt);
    let scalars = |salt: u64| image(salt).into_iter().map(|v| v[0]);
    let visible = scene.sources.len() as u64;
    Cotangents {
        base: image(0),
        normal: image(1),
        depth: scalars(2).collect(),
        warped: (0..visible).flat_map(|m| image(3 + m)).collect(),
        cosine: (0..visible).flat_map(|m| scalars(10 + m)).collect(),
    }
}

/// All outputs on the GPU within `tolerance` of the twin's, by the 2-norm.
pub(crate) fn assert_outputs(what: &str, ours: &Cotangents, truth: &Cotangents, tolerance: f64) {
    let pairs = [
        ("base", ours.base.as_flattened(), truth.base.as_flattened()),
        ("normal", ours.normal.as_flattened(), truth.normal.as_flattened()),
        ("depth", &ours.depth[..], &truth.depth[..]),
        ("warped", ours.warped.as_flattened(), truth.warped.as_flattened()),
        ("cosine", &ours.cosine[..], &truth.cosine[..]),
    ];
    for (name, ours, truth) in pairs {
        assert!(truth.iter().any(|v| *v != 0.0), "{what} {name}: nothing to compare");
        let error = relative_error(ours, truth);
        println!("{what} {name}: {error:.1e}");
        assert!(error <= tolerance, "{what} {name}: relative error {error:e}");
    }
}

#[test]
fn golden_surface_gradients() {
    for file in FILES {
        let golden = load_gradients(file);
        let (scene, v) = (golden_scene(&golden), golden_cotangents(&golden));
        for group in GROUPS {
            let ours = surface(&scene, &view_of(&scene, 0.5), warping(&scene), &only(&v, group));
            if group == "all" {
                assert_outputs(file, &ours.outputs, &scene.outputs(), 1e-5);
                let source: Vec<f64> = ours.source.iter().map(|s| f64::from(*s)).collect();
                assert_eq!(source, golden.arrays.get("out/slot").data, "{file} out/slot");
                assert_eq!(ours.most_visible as usize, scene.sources.len(), "{file}: most visible sources");
            }
            for name in TENSORS.into_iter().chain(["xy_pixels", "xy_pixels_abs"]) {
                let truth = golden.grad(group, name);
                assert!(independent(group, name) || truth.iter().any(|v| *v != 0.0), "{file} {group}/{name}");
                assert_gradient(&format!("{file} {group}/{name}"), ours.grad(name), truth, 1e-3);
            }
        }
    }
}

#[test]
fn random_walls_follow_the_twin() {
    for (seed, k) in [(1, 4), (2, 2), (3, 8), (4, 6)] {
        let mut scene = wall(seed, k);
        for photo in scene.sources.iter_mut().map(|source| &mut source.photo) {
            photo.iter_mut().flatten().for_each(|v| *v = (*v * 255.0).round() / 255.0);
        }
        let v = random_cotangents(&scene, seed);
        let (geometry, _) = scene.run();
        let truth = scene.grads(&geometry, &v);
        let ours = surface(&scene, &view_of(&scene, 0.5), warping(&scene), &v);
        assert_outputs(&format!("wall {seed}"), &ours.outputs, &scene.outputs(), 2e-5);
        for name in TENSORS.into_iter().chain(["xy_pixels", "xy_pixels_abs"]) {
            assert_gradient(&format!("wall {seed} {name}"), ours.grad(name), grad(&truth, name), 1e-3);
        }
    }
}

/// Without any gradient by them, surface and warping leave the base's gradients as they are.
#[test]
fn an_unused_surface_changes_no_gradient() {
    let scene = wall(5, 4);
    let v = only(&random_cotangents(&scene, 5), "base");
    let ours = surface(&scene, &view_of(&scene, 0.5), warping(&scene), &v);
    let plain = RasterView { surface: None, ..view_of(&scene, 0.5) };
    let base = crate::common::gradients(&scene.params, &plain, &v.base);
    for tensor in ibgs_reference::Tensor::ALL {
        let name = tensor.name();
        let error = relative_error(ours.grad(name), base.get(tensor));
        assert!(error < 1e-6, "{name}: {error:e}");
    }
    assert!(ours.grad("normal").iter().chain(ours.grad("offset")).all(|v| *v == 0.0));
}

/// The published model with the source photos and depth maps of its dump, for the test of this name.
pub(super) fn golden_dump(test: &str) -> Option<(Golden, Scene)> {
    let (golden, cloud) = load_dump(test)?;
    let depths = &golden.arrays.get("src_depths").data;
    let pixels = (golden.camera.width * golden.camera.height) as usize;
    let source = |(i, camera): (usize, &ibgs_core::camera::Camera)| Source {
        camera: *camera,
        photo: golden.arrays.get("src_images").image(i).into_iter().map(byte_color).collect(),
        valid: vec![true; pixels],
        depth: depths[i * pixels..][..pixels].to_vec(),
        reach: 1.0,
    };
    let scene = Scene {
        params: cloud.params,
        planes: ibgs_reference::geometry::PlaneParams { normals: cloud.normals, offsets: cloud.offsets },
        camera: golden.camera,
        background: [0.0; 3],
        sources: golden.source_cameras.iter().enumerate().map(source).collect(),
        k: 4,
        model: Model::Boxed,
    };
    Some((golden, scene))
}

fn quantile(values: &mut [f64], at: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * at).round() as usize]
}

#[test]
fn a_published_model_gives_its_surface_and_warped_colours() {
    let test = "gradients::surface::a_published_model_gives_its_surface_and_warped_colours";
    let Some((golden, scene)) = golden_dump(test) else { return };
    let pixels = (scene.camera.width * scene.camera.height) as usize;
    let zero = Cotangents::zeros(pixels, 4);
    let ours = surface(&scene, &view_of(&scene, 0.0), warping(&scene), &zero);
    let truth = &golden.arrays.get("median_intersected_depth").data;
    let mut errors: Vec<f64> = ours.outputs.depth.iter().zip(truth).map(|(a, b)| (a - b).abs() / b.max(1e-6)).collect();
    let (median, p99) = (quantile(&mut errors, 0.5), quantile(&mut errors, 0.99));
    println!("median depth: relative error {median:.1e} in the median, {p99:.1e} at 99 %");
    assert!(median <= 1e-6 && p99 <= 1e-5);
    let normals = golden.arrays.get("rendered_normal").image(0);
    let db = psnr(ours.outputs.normal.as_flattened(), normals.as_flattened());
    println!("normal map: {db:.1} dB");
    assert!(db >= 75.0);

    let feature = golden.arrays.get("cam_feat");
    let filled = |m: usize, p: usize| (0..4).any(|c| feature.data[(m * 4 + c) * pixels + p] != 0.0);
    let counts: Vec<usize> = (0..pixels).map(|p| (0..4).filter(|&m| filled(m, p)).count()).collect();
    let ours_count = |p: usize| (0..4).filter(|&m| ours.source[m * pixels + p] >= 0).count();
    let equal: Vec<usize> = (0..pixels).filter(|&p| ours_count(p) == counts[p]).collect();
    let share = equal.len() as f64 / pixels as f64;
    println!("visible sources: equal number at {:.3} % of the pixels", 100.0 * share);
    assert!(share >= 0.9995);
    for m in 0..4 {
        let published = golden.arrays.get("warped_image").image(m);
        let both: Vec<usize> = equal.iter().copied().filter(|&p| counts[p] > m).collect();
        let pick = |image: &dyn Fn(usize) -> [f64; 3]| both.iter().flat_map(|&p| image(p)).collect::<Vec<_>>();
        let db = psnr(&pick(&|p| ours.outputs.warped[m * pixels + p]), &pick(&|p| published[p]));
        println!("warped colours, visible source {m}: {db:.1} dB over {} pixels", both.len());
        assert!(db >= 75.0);
    }
}

#[test]
fn a_published_models_surface_gradients_follow_the_twin() {
    let test = "gradients::surface::a_published_models_surface_gradients_follow_the_twin";
    let Some((_, scene)) = golden_dump(test) else { return };
    let v = random_cotangents(&scene, 7);
    let (geometry, _) = scene.run();
    let truth = scene.grads(&geometry, &v);
    let ours = surface(&scene, &view_of(&scene, 0.5), warping(&scene), &v);
    for name in TENSORS.into_iter().chain(["xy_pixels", "xy_pixels_abs"]) {
        assert_gradient(&format!("published model {name}"), ours.grad(name), grad(&truth, name), 2e-3);
    }
}

/// The same input gives the same bits.
#[test]
fn surface_results_repeat_bit_for_bit() {
    let scene = wall(6, 4);
    let v = random_cotangents(&scene, 6);
    let run = || surface(&scene, &view_of(&scene, 0.5), warping(&scene), &v);
    let first = run();
    for _ in 0..3 {
        let again = run();
        assert!(first.outputs == again.outputs && first.source == again.source && first.grads == again.grads);
    }
}
