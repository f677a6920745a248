//! Small trainings, and a model from one.

use ibgs_core::config::{Method, TrainConfig};
use ibgs_core::dataset::Dataset;
use ibgs_core::render::{ImagePart, Renderer};
use ibgs_core::residual::ResidualNetwork;
use ibgs_core::scene::{Gaussians, Splats};
use ibgs_core::sources::source_store::SourceStore;
use ibgs_demo::DemoOptions;
use ibgs_reference::gpu::{gpu, rasterizer};
use ibgs_testing::tiny_demo;
use ibgs_train::Trainer;
use std::sync::{Arc, OnceLock};

/// Options of a run without any densification or opacity reset.
pub fn plain(iterations: u32) -> TrainConfig {
    let mut config = TrainConfig { method: Method::Gs3, iterations: Some(iterations), ..TrainConfig::default() };
    config.densify.start = Some(iterations);
    config.densify.end = Some(iterations);
    config.opacity_reset.interval = Some(10 * iterations);
    config
}

/// A trainer on the tests' GPU.
pub fn trainer(dataset: &Dataset, config: &TrainConfig) -> Trainer {
    config.validate().unwrap();
    Trainer::new(Arc::new(rasterizer()), dataset, config).unwrap()
}

/// Trains up to an iteration.
pub fn run(trainer: &mut Trainer, until: u32) {
    while trainer.iteration() < until {
        trainer.step().unwrap();
    }
}

/// The tiny demo with enough views that neighbours see the same: 28 training views.
pub fn dataset() -> Dataset {
    static DATASET: OnceLock<Dataset> = OnceLock::new();
    let trace = || {
        let cache = tempfile::tempdir().unwrap();
        ibgs_demo::load(&DemoOptions { views: 32, ..tiny_demo() }, Some(cache.path()), &()).unwrap()
    };
    DATASET.get_or_init(trace).clone()
}

/// Surface losses after 10 iterations, the residual after 14, burn-in for 8. The network runs at a quarter of the size, which is
/// ten times faster on a processor.
pub fn staged(iterations: u32) -> TrainConfig {
    let mut config = TrainConfig { method: Method::Ibgs, ..plain(iterations) };
    config.surface.start = Some(10);
    config.residual.start = Some(14);
    config.residual.burn_in = Some(8);
    config.residual.halve_at = Some(Vec::new());
    config.residual.factor = Some(0.25);
    config
}

/// A model that was trained for a moment, and its scene.
pub fn small_model() -> (Renderer, Dataset) {
    static MODEL: OnceLock<(Gaussians, Option<Vec<f32>>)> = OnceLock::new();
    let (dataset, config) = (dataset(), staged(40));
    let (gaussians, network) = MODEL.get_or_init(|| {
        let mut trainer = trainer(&dataset, &config);
        run(&mut trainer, 40);
        model(&trainer)
    });
    let part = image_part(&dataset, &config, network.as_ref().unwrap());
    let splats = Splats::upload(gaussians, &gpu()).unwrap();
    (Renderer::new(Arc::new(rasterizer()), splats, [0.0; 3], Some(part)), dataset)
}

/// The image-based part of a model of a dataset.
pub fn image_part(dataset: &Dataset, config: &TrainConfig, network: &[f32]) -> ImagePart {
    let training = || dataset.train.iter().map(|&index| &dataset.views[index]);
    let photos = training().map(|view| view.photo.clone()).collect();
    ImagePart {
        cameras: training().map(|view| view.camera).collect(),
        photos: Arc::new(SourceStore::new(gpu(), photos, None).unwrap()),
        network: ResidualNetwork::from_values(&gpu(), network).unwrap(),
        options: config.image_options(),
    }
}

/// Gaussians and network as they stand.
pub fn model(trainer: &Trainer) -> (Gaussians, Option<Vec<f32>>) {
    let gaussians = trainer.splats().download(&gpu()).unwrap();
    gaussians.validate().unwrap();
    (gaussians, trainer.renderer().unwrap().part().map(|part| part.network.to_values(&gpu()).unwrap()))
}
