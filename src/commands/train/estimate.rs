//! What a training will take of the device's memory, told before it begins.

use ibgs_core::camera::Camera;
use ibgs_core::dataset::Dataset;
use ibgs_core::memory::{Bytes, Demand, Estimate};
use ibgs_core::raster::Rasterizer;
use ibgs_core::train::Trainer;
use ibgs_core::train::config::TrainConfig;

/// `memory: needs about 310 MiB at 5000 Gaussians, 1.2 GiB at 1000000 (--max-splats)`. wgpu tells nowhere how much the
/// device has, so that is left to the reader.
pub fn sentence(trainer: &Trainer, raster: &Rasterizer, dataset: &Dataset, config: &TrainConfig) -> String {
    let cameras: Vec<Camera> = dataset.train.iter().map(|&index| dataset.views[index].camera).collect();
    let gaussians = trainer.splats().len() as u64;
    let most = u64::from(config.densify.most());
    let grows = config.init.is_none() && gaussians < most;
    let now = Demand {
        config,
        sh_degree: trainer.splats().sh_degree(),
        cameras: &cameras,
        gaussians,
        room: raster.capacity(),
        photo_budget: config.sources.memory.bytes(raster.gpu()),
        grows,
        evaluates: !dataset.test.is_empty(),
    };
    let bytes = |demand: &Demand| Bytes(Estimate::new(demand).total());
    let mut text = format!("memory: needs about {} at {gaussians} Gaussians", bytes(&now));
    if grows {
        text += &format!(", {} at {most} (`--max-splats`)", bytes(&now.grown_to(most)));
    }
    text
}
