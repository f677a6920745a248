//! The 3D smoothing filter: its sizes, its place in the projection, and models saved with it.

use crate::common::gradients;
use glam::DVec3;
use ibgs_core::gpu::Pass;
use ibgs_core::raster::RasterView;
use ibgs_core::scene::Splats;
use ibgs_reference::gpu::{assert_images_agree, gpu, render, splats};
use ibgs_reference::random_scene::{exact, random_camera, random_image, random_params};
use ibgs_reference::{self as reference, Params, Tensor, relative_error};
use ibgs_shaders::bindings::FilterSizesBindings;
use ibgs_shaders::types::FilterParams;

/// A random scene with filters from a tenth of the scales to twice as large, and some without.
fn filtered_params(seed: u64) -> Params {
    let mut p = random_params(250, 2, seed);
    p.filters = (0..250).map(|i| exact(if i % 5 == 0 { 0.0 } else { 0.003 * f64::from(1 + i % 40) })).collect();
    p
}

#[test]
fn filtered_images_and_gradients_follow_the_twin() {
    for seed in [60, 61] {
        let p = filtered_params(seed);
        let camera = random_camera(65, 47, seed);
        let cotangent = random_image(65, 47, -1.0, 1.0, seed);
        let view = RasterView::new(camera, 2);
        let forward = reference::render(&p, &camera, [0.0; 3], 2);
        assert_images_agree("filtered", &render(&p, &view), &forward.image, 2e-5);
        let plain = Params { filters: Vec::new(), ..p.clone() };
        assert!(
            relative_error(&render(&plain, &view), forward.image.as_flattened()) > 1e-2,
            "the filter does something"
        );
        let twin = reference::backward(&p, &camera, [0.0; 3], &forward, &cotangent);
        let ours = gradients(&p, &view, &cotangent);
        for name in Tensor::ALL {
            let error = relative_error(ours.get(name), twin.get(name));
            println!("seed {seed} {name:?}: {error:.1e}");
            assert!(error <= 1e-3 && twin.get(name).iter().any(|v| *v != 0.0), "seed {seed} {name:?}: {error:e}");
        }
    }
}

/// Files hold the filter as a part of scales and opacities, so any viewer shows the same image.
#[test]
fn a_model_without_its_filters_but_with_their_effect_renders_alike() {
    let p = filtered_params(62);
    let view = RasterView::new(random_camera(80, 60, 62), 2);
    let model = splats(&p);
    let (raw, filters) = model.download_raw(&gpu()).unwrap();
    assert_eq!(filters.iter().map(|v| f64::from(*v)).collect::<Vec<_>>(), p.filters);
    let saved = model.download(&gpu()).unwrap();
    assert!(saved.log_scales != raw.log_scales && saved.opacity_logits != raw.opacity_logits);
    let raster = ibgs_reference::gpu::rasterizer();
    let again = raster.render(&Splats::upload(&saved, &gpu()).unwrap(), &view).unwrap();
    let ours = ibgs_reference::gpu::pixels(&raster.render(&model, &view).unwrap(), &view.camera);
    let image: Vec<[f64; 3]> = ours.as_chunks().0.to_vec();
    assert_images_agree("saved", &ibgs_reference::gpu::pixels(&again, &view.camera), &image, 2e-5);
}

#[test]
fn sizes_are_those_of_the_nearest_camera() {
    let gpu = gpu();
    let p = random_params(300, 0, 63);
    let views: Vec<_> = (0..5).map(|i| random_camera(40 + 10 * i, 30, u64::from(i))).collect();
    let rows: Vec<[f32; 4]> =
        views.iter().map(|c| c.center().extend(c.focal.max_element()).as_vec4().to_array()).collect();
    let means: Vec<[f32; 3]> = p.means.iter().map(|m| m.map(|v| v as f32)).collect();
    let means = gpu.upload("means", means.as_flattened()).unwrap();
    let cameras = gpu.upload("cameras", &rows).unwrap();
    let filters = gpu.upload("filters", &vec![-1.0f32; 300]).unwrap();
    // The last Gaussian is beyond the count.
    let params = FilterParams { count: 299, cameras: 5, factor: 0.5 };
    let mut pass = Pass::new(&gpu, "test");
    pass.linear(&FilterSizesBindings { means: &means, cameras: &cameras, filters: &filters }, &params, 300);
    pass.submit();
    let ours = gpu.read(&filters, 300).unwrap();
    for (mean, ours) in p.means.iter().zip(&ours).take(299) {
        let size = |c: &ibgs_core::camera::Camera| c.center().distance(DVec3::from(*mean)) / c.focal.max_element();
        let truth = 0.5 * views.iter().map(size).fold(f64::INFINITY, f64::min);
        assert!((f64::from(*ours) / truth - 1.0).abs() < 1e-5, "{ours} for {truth}");
    }
    assert_eq!(ours[299], -1.0);
}
