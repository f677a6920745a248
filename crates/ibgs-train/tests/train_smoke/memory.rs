//! The estimate of a training's memory against what it takes.

use ibgs_core::camera::Camera;
use ibgs_core::config::{Method, TrainConfig};
use ibgs_core::dataset::{Dataset, HostPhoto, Masks, Photo, PointsFrom, View};
use ibgs_core::gpu::Bytes;
use ibgs_core::gpu::Gpu;
use ibgs_core::raster::Rasterizer;
use ibgs_core::scene::Gaussians;
use ibgs_reference::gpu::open_gpu;
use ibgs_train::Trainer;
use ibgs_train::bench::synthetic;
use ibgs_train::memory::{Demand, Estimate};
use std::sync::Arc;

/// A grey photo of three views side by side.
fn dataset(camera: &Camera) -> Dataset {
    let (width, height) = (camera.width, camera.height);
    let rgba = [128, 128, 128, 255].repeat((width * height) as usize);
    let photo = HostPhoto::from(Photo { width, height, rgba });
    let view = |i: usize| {
        let mut camera = *camera;
        camera.translation.x = 0.1 * i as f64;
        View { name: i.to_string(), camera, photo: photo.clone() }
    };
    let views: Vec<View> = (0..3).map(view).collect();
    let train = (0..views.len()).collect();
    Dataset {
        path: Default::default(),
        views,
        train,
        test: Vec::new(),
        points: Vec::new(),
        extent: None,
        masks: Masks::Ignore,
        backdrop: None,
        glossy: None,
        made_tracks: Default::default(),
        loaded_checksum: None,
        points_from: PointsFrom::Scene,
        notes: Vec::new(),
    }
}

/// Estimated and allocated bytes of three iterations with everything at work.
fn compare(gpu: &Arc<Gpu>, (method, bands): (Method, u32), gaussians: &Gaussians, camera: &Camera) -> f64 {
    let mut config = TrainConfig { method, ..TrainConfig::default() };
    config.residual.bands = bands;
    (config.surface.start, config.residual.start, config.residual.burn_in) = (Some(0), Some(0), Some(0));
    let dataset = dataset(camera);
    let raster = Arc::new(Rasterizer::new(gpu.clone()));
    let mut trainer = Trainer::from_gaussians(raster.clone(), &dataset, &config, gaussians).unwrap();
    for _ in 0..3 {
        trainer.step().unwrap();
    }
    gpu.wait().unwrap();
    let memory = gpu.memory_report().expect("the driver of the tests tells");
    let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
    let estimate = Estimate::new(&Demand {
        config: &config,
        sh_degree: gaussians.sh_degree,
        cameras: &cameras,
        gaussians: gaussians.len() as u64,
        room: raster.capacity(),
        photo_budget: None,
        grows: false,
        evaluates: false,
    });
    for kind in memory.kinds.iter().take(12) {
        println!("{:>12} in {:>4} {}", kind.bytes, kind.buffers, kind.name);
    }
    println!("{method:?}, {bands}: {} allocated, {} estimated", Bytes(memory.allocated_bytes), Bytes(estimate.total()));
    estimate.total() as f64 / memory.allocated_bytes as f64
}

/// On a device of its own: the other one holds the memory of other tests.
#[test]
fn the_estimate_is_what_the_allocator_reports() {
    let gpu = open_gpu();
    for (method, bands, [width, height]) in
        [(Method::Gs3, 1, [72, 48]), (Method::Ibgs, 1, [72, 48]), (Method::Ibgs, 2, [72, 257])]
    {
        let (gaussians, camera) = synthetic(20_000, 2, width, height);
        gpu.release_unused();
        gpu.wait().unwrap();
        let ratio = compare(&gpu, (method, bands), &gaussians, &camera);
        assert!((0.75..=1.25).contains(&ratio), "{method:?}, {bands}: {ratio:.2} of what is allocated");
    }
}
