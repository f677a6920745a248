//! Kernels that have a form for subgroups, against their form for devices without.

use ibgs_data::scene::Gaussians;
use ibgs_reference::gpu::view_of;
use ibgs_reference::gpu::{gaussians, gpu, open_gpu, without_subgroups};
use ibgs_reference::random_scene::{random_camera, random_params};
use ibgs_reference::relative_error;
use ibgs_reference::surface_scene::wall;
use ibgs_render::gpu::{Buffer, Gpu};
use ibgs_render::raster::{Keep, RasterView, Rasterizer, Room, ScreenStatistics};
use ibgs_render::scene::{PerGaussian, Splats};
use ibgs_shaders::TILE_SORT;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// What a pass gives, and its gradients from random ones of all that it gives.
struct Results {
    outputs: Vec<Vec<f32>>,
    gradients: Vec<Vec<f64>>,
}

fn results(gpu: &Arc<Gpu>, model: &Gaussians, view: &RasterView) -> Results {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut random = |buffer: &Buffer<f32>, count: usize| {
        let values: Vec<f32> = (0..count).map(|_| rng.random_range(-1.0..1.0)).collect();
        gpu.write(buffer, 0, &values);
    };
    let splats = Splats::upload(model, gpu).unwrap();
    let raster = Rasterizer::new(gpu.clone());
    // Makes room for every intersection.
    raster.render(&splats, view).unwrap();
    let image = raster.image_memory(&view.camera).unwrap();
    let mut forward = raster.forward(&splats, view, Keep::Gradients, image).unwrap();
    let (n, pixels) = (model.len(), view.camera.pixels());
    let buffer = |count: usize| gpu.allocate("test", count).unwrap();
    let read = |buffer: &Buffer<f32>, count: usize| gpu.read(buffer, count).unwrap();
    let mut outputs = vec![read(&forward.image, 3 * pixels)];
    let v_image = buffer(3 * pixels);
    random(&v_image, 3 * pixels);
    if let Some(surface) = forward.surface() {
        let medians = 2 * surface.options.intersections as usize * pixels;
        outputs.push(read(&raster.depth_map(&splats, view, Room::Checked).unwrap(), pixels));
        let frame = raster.surface(&splats, view).unwrap();
        outputs.push(read(&frame.image, 3 * pixels));
        outputs.push(read(&frame.surface().unwrap().intersections.cast(), medians));
        outputs.push(read(&surface.normal_map, 3 * pixels));
        outputs.push(read(&surface.median_depth, pixels));
        outputs.push(read(&surface.intersections.cast(), medians));
        let v = surface.v.as_ref().unwrap();
        random(&v.normal_map, 3 * pixels);
        random(&v.median_depth, pixels);
        random(&v.intersections.cast(), medians);
    }
    let rows = PerGaussian::gradient_rows();
    let is_there = PerGaussian::with_gradients(view.surface.is_some());
    let parameters = rows.zip(is_there).map(|(row, is_there)| is_there.then(|| buffer(row * n)));
    let values = gpu.upload("test", &vec![[0.0; 4]; n]).unwrap();
    forward.statistics = Some(ScreenStatistics { values: values.clone(), largest: false, near_depth: 0.0 });
    forward.backward(gpu, &splats, &v_image, &parameters);
    let own = parameters.zip(rows).into_array().into_iter().filter_map(|(buffer, row)| Some((buffer?, row * n)));
    let double = |(buffer, count)| read(&buffer, count).into_iter().map(f64::from).collect();
    Results { outputs, gradients: own.chain([(values.cast(), 4 * n)]).map(double).collect() }
}

/// The images are equal bit for bit. Gradients are sums in another order.
#[test]
fn the_rasterizer_gives_the_same_with_subgroups_and_without() {
    let without = without_subgroups();
    assert_eq!(without.subgroup_lanes, None);
    let with = gpu();
    println!("{:?} lanes", with.subgroup_lanes);
    let random = random_params(2000, 2, 4);
    let mut cases = vec![(gaussians(&random), RasterView::new(random_camera(150, 90, 4), 2))];
    for (seed, k) in [(5, 2), (6, 4), (7, 8)] {
        let scene = wall(seed, k);
        let mut model = gaussians(&scene.params);
        model.normals = scene.planes.normals.iter().map(|n| n.map(|x| x as f32)).collect();
        model.offsets = scene.planes.offsets.iter().map(|x| *x as f32).collect();
        cases.push((model, view_of(&scene, 0.5)));
    }
    for (case, (model, view)) in cases.iter().enumerate() {
        let [a, b] = [&with, &without].map(|gpu| results(gpu, model, view));
        assert!(a.outputs == b.outputs, "case {case}: images");
        for (index, (a, b)) in a.gradients.iter().zip(&b.gradients).enumerate() {
            assert!(b.iter().any(|v| *v != 0.0), "case {case}: gradient {index} is zero");
            let error = relative_error(a, b);
            assert!(error <= 1e-4, "case {case}, gradient {index}: {error:e}");
        }
    }
}

/// With a kernel for twice as many lanes, which stands for a wrong driver.
#[test]
fn wrong_subgroups_are_found() {
    assert!(without_subgroups().sorts_right().unwrap());
    let Some(lanes) = gpu().subgroup_lanes else {
        return ibgs_testing::skipped("wrong_subgroups_are_found", "the adapter has no fixed number of lanes");
    };
    let gpu = open_gpu();
    assert!(gpu.sorts_right().unwrap());
    let source = TILE_SORT.wgsl_with_subgroups(2 * lanes);
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("for other subgroups"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    gpu.replace_kernel(&TILE_SORT, &module);
    assert!(!gpu.sorts_right().unwrap());
}
