//! Rendering on a device that has no more than a browser's.

use crate::small::small_model;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::local_space::LocalSpace;
use ibgs_core::raster::{RasterView, Rasterizer, SurfaceOptions};
use ibgs_core::render::{ImageOptions, ImagePart, Renderer};
use ibgs_core::residual::{Precision, ResidualNetwork};
use ibgs_core::scene::{Gaussians, Harmonics, Splats};
use ibgs_core::sources::source_store::SourceStore;
use ibgs_reference::gpu::{device_of, gpu, rasterizer};
use ibgs_reference::random_scene::random_camera;
use std::sync::Arc;

/// The tests' adapter with what WebGPU promises and no more: its default limits, and no feature at all.
fn limited() -> Arc<Gpu> {
    device_of(|_| wgpu::DeviceDescriptor::default())
}

#[test]
fn frames_are_the_same_bit_for_bit() {
    let (model, dataset) = small_model();
    let usual = gpu();
    let limited = limited();
    limited.watch();
    // Half precision on matrix units would differ.
    let part = model.part().unwrap().clone();
    let part = ImagePart { options: ImageOptions { precision: Precision::Full, ..part.options }, ..part };
    let renderer = Renderer::new(Arc::new(rasterizer()), model.splats().clone(), [0.0; 3], Some(part.clone()));
    let photos = dataset.train.iter().map(|&index| dataset.views[index].photo.clone()).collect();
    let part = ImagePart {
        cameras: part.cameras.clone(),
        photos: Arc::new(SourceStore::new(limited.clone(), photos, None).unwrap()),
        network: ResidualNetwork::from_values(&limited, &part.network.to_values(&usual).unwrap()).unwrap(),
        options: part.options.clone(),
    };
    let splats = Splats::upload(&renderer.splats().download(&usual).unwrap(), &limited).unwrap();
    let raster = Arc::new(Rasterizer::new(limited.clone()));
    let other = Renderer::new(raster, splats, [0.0; 3], Some(part));
    for &index in &dataset.test {
        let camera = &dataset.views[index].camera;
        let [expected, found] = [&renderer, &other].map(|renderer| renderer.render(camera).unwrap());
        let both = [&expected, &found];
        let [a, b] = both.map(|frame| frame.image().unwrap().unwrap().rgb);
        assert!(a == b, "final image of {}", dataset.views[index].name);
        let [a, b] = both.map(|frame| frame.base().unwrap().rgb);
        assert!(a == b, "base image of {}", dataset.views[index].name);
        let [a, b] = both.map(|frame| frame.depth().unwrap().unwrap());
        assert!(a == b, "median depth of {}", dataset.views[index].name);
        let [a, b] = both.map(|frame| frame.normals().unwrap().unwrap());
        assert!(a == b, "normals of {}", dataset.views[index].name);
    }
    limited.check().unwrap();
}

/// Small Gaussians of degree 2, evenly spread in a cube.
fn many(count: usize) -> Gaussians {
    let spread = |i: usize, step: f64| ((i as f64 * step).fract() * 2.4 - 1.2) as f32;
    Gaussians {
        space: LocalSpace::default(),
        means: (0..count).map(|i| [0.819_172_5, 0.671_043_6, 0.549_700_5].map(|step| spread(i, step))).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
        log_scales: vec![[-6.0; 3]; count],
        opacity_logits: vec![-2.0; count],
        sh: (0..27 * count).map(|i| 0.3 * spread(i, 0.618_034)).collect(),
        sh_degree: 2,
        normals: vec![[0.0, 0.0, 1.0]; count],
        offsets: vec![0.0; count],
        antialiased: false,
    }
}

/// In single precision their colours are more than the device binds at once.
#[test]
fn two_million_gaussians_have_an_image() {
    let (limited, camera) = (limited(), random_camera(96, 72, 20));
    limited.watch();
    let model = many(2_000_000);
    let view = RasterView { surface: Some(SurfaceOptions::default()), ..RasterView::new(camera, 2) };
    let image = |gpu: &Arc<Gpu>, harmonics| {
        let splats = Splats::upload_in(&model, gpu, harmonics).unwrap();
        let forward = Rasterizer::new(gpu.clone()).surface(&splats, &view).unwrap();
        gpu.read(&forward.image, 3 * camera.pixels()).unwrap()
    };
    let full = image(&limited, Harmonics::Full);
    assert!(full == image(&gpu(), Harmonics::Full));
    let half = image(&limited, Harmonics::Half);
    let most = full.iter().zip(&half).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(most > 0.0 && most < 1.0 / 255.0, "{most}");
    let lit = full.iter().filter(|v| **v > 0.05).count();
    assert!(2 * lit > full.len(), "{lit} values of {}", full.len());
    limited.check().unwrap();
}

#[test]
fn a_training_says_what_the_device_lacks() {
    let error = limited().warm_up(true).unwrap_err();
    assert!(matches!(&error, GpuError::Lacking { missing, .. } if missing.contains("storage buffers")), "{error}");
}

/// What a browser does gives the same frames, also where nothing has room at first.
#[test]
fn frames_for_browsers_have_room() {
    let (model, dataset) = small_model();
    let camera = &dataset.views[dataset.test[0]].camera;
    let fresh = || {
        let part = model.part().cloned();
        let raster = rasterizer();
        raster.set_capacity(16);
        Renderer::new(Arc::new(raster), model.splats().clone(), [0.0; 3], part)
    };
    let expected = fresh().render(camera).unwrap().image().unwrap().unwrap();
    let frame = pollster::block_on(fresh().render_async(camera, |_| Ok(()))).unwrap();
    let found = pollster::block_on(frame.image_async()).unwrap().unwrap();
    assert!(expected.rgb == found.rgb);
    let base = pollster::block_on(frame.base_async()).unwrap();
    assert!(base.rgb == frame.base().unwrap().rgb && base.rgb != found.rgb);
}
