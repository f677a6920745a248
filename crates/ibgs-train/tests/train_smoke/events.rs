//! Densification, pruning and opacity resets happen when the schedule says, and only then. Those of an iteration come
//! before the next one's step, so they show one step later.

use super::{dataset, densifying, psnr, trained};
use crate::small::{plain, run, trainer};
use ibgs_core::config::Strategy;
use ibgs_reference::gpu::gpu;
use ibgs_train::Trainer;

fn opacities(trainer: &Trainer) -> Vec<f32> {
    let logits = trainer.splats().download(&gpu()).unwrap().opacity_logits;
    logits.into_iter().map(|logit| 1.0 / (1.0 + (-logit).exp())).collect()
}

fn largest(values: &[f32]) -> f32 {
    values.iter().copied().fold(0.0, f32::max)
}

#[test]
fn milestones_come_when_the_schedule_says() {
    let mut config = densifying(60, 45);
    config.opacity_reset.interval = Some(25);
    let mut trainer = trainer(&dataset(), &config);
    let (mut rounds, mut resets) = (Vec::new(), Vec::new());
    while trainer.iteration() < 60 {
        let count = trainer.splats().len();
        let before = largest(&opacities(&trainer));
        trainer.step().unwrap();
        let milestone = trainer.iteration() - 1;
        let after = largest(&opacities(&trainer));
        if trainer.splats().len() != count {
            rounds.push(milestone);
        }
        if after < 0.5 * before {
            // The reset's 0.01 and one step of the logit by its rate of 0.025.
            assert!(after <= 0.010_26, "opacity {after} after a reset");
            resets.push(milestone);
        }
    }
    assert_eq!(rounds, [10, 20, 30, 40]);
    assert_eq!(resets, [25]);
    let schedule = trainer.schedule();
    assert!((1..=60).filter(|&i| schedule.densify_at(i)).eq(rounds));
    assert!((1..=60).filter(|&i| schedule.reset_opacity_at(i)).eq(resets));
    let model = trainer.splats().download(&gpu()).unwrap();
    model.validate().unwrap();
    assert!(model.len() > 300, "{} Gaussians", model.len());
    // Rounds soon after a reset must not take the transparent Gaussians away; these recover.
    assert!(largest(&opacities(&trainer)) > 0.02);
}

#[test]
fn a_run_with_all_milestones_scaled_down_ends_well() {
    // 50 iterations: resets every 5, a degree every 2, densification off.
    let config = ibgs_core::config::TrainConfig { iterations: Some(50), ..Default::default() };
    assert_eq!(trained(&dataset(), &config).len(), 300);
}

#[test]
fn the_most_gaussians_are_not_exceeded() {
    let dataset = dataset();
    let mut config = densifying(45, 45);
    let free = trained(&dataset, &config).len();
    assert!(free > 340, "only {free} Gaussians without a limit");
    config.densify.max_splats = Some(340);
    let mut trainer = trainer(&dataset, &config);
    let mut most = 0;
    while trainer.iteration() < 45 {
        trainer.step().unwrap();
        most = most.max(trainer.splats().len());
    }
    assert_eq!(most, 340);
}

#[test]
fn every_strategy_trains_and_repeats() {
    let dataset = dataset();
    for &strategy in Strategy::ALL {
        let mut config = densifying(60, 60);
        config.densify.strategy = strategy;
        config.densify.max_splats = Some(330);
        let mut first = trainer(&dataset, &config);
        let view = &dataset.views[dataset.train[0]];
        let early = psnr(&first, view);
        run(&mut first, 60);
        let late = psnr(&first, view);
        assert!(late > early + 0.5, "{strategy:?}: from {early} to {late} dB");
        let grown = first.splats().len();
        // MCMC reaches its cap, the others only keep it.
        assert!((301..=330).contains(&grown) && (strategy != Strategy::Mcmc || grown == 330), "{strategy:?}: {grown}");
        let model = first.splats().download(&gpu()).unwrap();
        assert!(model == trained(&dataset, &config), "{strategy:?}: another model");
    }
}

#[test]
fn pruning_removes_the_transparent_and_the_large() {
    let dataset = dataset();
    let mut config = densifying(15, 15);
    // No gradient is that large: rounds prune only.
    config.densify.grad_threshold = 1e9;
    config.densify.abs_split = false;
    config.densify.prune_opacity = 0.1;
    let pruned = trained(&dataset, &config);
    assert!((1..300).contains(&pruned.len()), "{} Gaussians left", pruned.len());

    config.densify.prune_opacity = 0.0;
    config.densify.prune_scale = 0.05;
    config.densify.prune_scale_by_distance = false;
    config.densify.prune_scale_after = Some(5);
    let mut trainer = trainer(&dataset, &config);
    let limit = (0.05 * trainer.extent()).ln() as f32;
    let is_large = |row: &[f32; 3]| row.iter().any(|s| *s > limit);
    run(&mut trainer, 10);
    assert!(trainer.splats().download(&gpu()).unwrap().log_scales.iter().any(is_large));
    run(&mut trainer, 11);
    let left = trainer.splats().download(&gpu()).unwrap();
    assert!((1..300).contains(&left.len()) && !left.log_scales.iter().any(is_large), "{} left", left.len());
}

#[test]
fn a_model_that_loses_every_gaussian_goes_on() {
    let mut config = densifying(25, 15);
    config.densify.prune_opacity = 0.999;
    assert_eq!(trained(&dataset(), &config).len(), 0);
}

#[test]
fn one_training_view_is_enough() {
    let mut dataset = dataset();
    dataset.train.truncate(1);
    let model = trained(&dataset, &densifying(30, 30));
    assert!(model.len() >= 300, "{} Gaussians", model.len());
    // Positions move with the scene's extent, which one camera does not have.
    let start = trainer(&dataset, &plain(1)).splats().download(&gpu()).unwrap();
    assert!(model.sh != start.sh);
}
