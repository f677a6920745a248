//! Short trainings of a tiny scene: what must happen in every run, and what must not.

mod adjusted;
mod checkpoint;
mod ensemble;
mod events;
mod fit_poses;
pub mod image_based;
mod inputs;
mod lost_device;
mod masks;
mod memory;
mod own;
mod poses;
mod start;
mod transients;
mod units;
mod unwritten;

use crate::small::{plain, run, trainer};
use ibgs_core::config::{Strategy, TrainConfig};
use ibgs_core::dataset::{Dataset, View};
use ibgs_core::eval::score_view;
use ibgs_core::gpu::Buffer;
use ibgs_core::scene::Gaussians;
use ibgs_reference::gpu::{gpu, rasterizer};
use ibgs_testing::tiny_demo;
use ibgs_train::{TrainError, Trainer};
use std::sync::{Arc, OnceLock};

/// The tiny demo: 8 training and 2 test views, 300 points.
fn dataset() -> Dataset {
    static DATASET: OnceLock<Dataset> = OnceLock::new();
    let trace = || {
        let cache = tempfile::tempdir().unwrap();
        ibgs_demo::load(&tiny_demo(), Some(cache.path()), &()).unwrap()
    };
    DATASET.get_or_init(trace).clone()
}

/// The same with rounds of densification every 10 iterations up to `end`.
fn densifying(iterations: u32, end: u32) -> TrainConfig {
    let mut config = plain(iterations);
    config.densify.strategy = Strategy::Published;
    config.densify.start = Some(9);
    config.densify.interval = Some(10);
    config.densify.end = Some(end);
    config
}

/// The model after all iterations.
fn trained(dataset: &Dataset, config: &TrainConfig) -> Gaussians {
    let mut trainer = trainer(dataset, config);
    run(&mut trainer, config.iterations());
    assert!(!trainer.overflowed());
    let model = trainer.splats().download(&gpu()).unwrap();
    model.validate().unwrap();
    model
}

/// Makes the first values of a trained parameter infinite.
fn poison(parameter: &Buffer<f32>) {
    let gpu = gpu();
    gpu.write(parameter, 0, &[f32::INFINITY; 4]);
    gpu.wait().unwrap();
}

/// PSNR of a view in dB as the trainer's model stands.
fn psnr(trainer: &Trainer, view: &View) -> f64 {
    score_view(&trainer.renderer().unwrap(), view, None).unwrap().1.base.psnr
}

#[test]
fn the_loss_falls_and_the_pictures_come_nearer() {
    let dataset = dataset();
    let mut trainer = trainer(&dataset, &plain(130));
    let views = [dataset.train[0], dataset.train[5], dataset.test[1]].map(|i| &dataset.views[i]);
    let before = views.map(|view| psnr(&trainer, view));
    let mut losses: Vec<f32> = Vec::new();
    for _ in 0..130 {
        trainer.step().unwrap();
        // Statistics come back without waiting; here every one is wanted.
        gpu().wait().unwrap();
        let stats = trainer.telemetry().stats;
        if stats.loss > 0.0 && losses.last() != Some(&stats.loss) {
            losses.push(stats.loss);
        }
    }
    assert!(losses.len() >= 3 && losses.is_sorted_by(|a, b| a > b), "losses {losses:?}");
    assert!(losses[losses.len() - 1] < 0.9 * losses[0], "losses {losses:?}");
    let after = views.map(|view| psnr(&trainer, view));
    println!("PSNR from {before:.2?} to {after:.2?} dB, losses {losses:.3?}");
    for (before, after) in before.iter().zip(after) {
        assert!(after > before + 1.5, "PSNR from {before:.2} to {after:.2} dB");
    }
    // The running figure belongs to the iterations before, so it lies between start and end.
    let running = f64::from(trainer.telemetry().stats.psnr());
    assert!(running > before[0].min(before[1]) && running < after[0].max(after[1]) + 1.0, "running PSNR {running}");
}

#[test]
fn a_seed_repeats_a_run_bit_for_bit() {
    let dataset = dataset();
    let config = densifying(60, 50);
    let first = trained(&dataset, &config);
    assert!(first.len() > 300, "the runs must densify");
    assert!(first == trained(&dataset, &config), "the same seed gave another model");
    let other = TrainConfig { seed: 1, ..config };
    assert!(first != trained(&dataset, &other), "another seed gave the same model");
}

#[test]
fn without_a_training_view_nothing_starts() {
    let mut dataset = dataset();
    dataset.train.clear();
    let error = Trainer::new(Arc::new(rasterizer()), &dataset, &plain(1)).err().unwrap();
    assert!(matches!(error, TrainError::NoViews));
    assert!(error.to_string().contains("no training view"), "{error}");
}
