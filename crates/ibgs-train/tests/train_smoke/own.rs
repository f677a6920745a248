//! Losses and strategies that a program adds to a training.

use super::densifying;
use crate::small::{dataset, model, run, staged, trainer};
use burn::tensor::Tensor;
use ibgs_core::config::DensifyConfig;
use ibgs_core::gpu::GpuError;
use ibgs_demo::DemoOptions;
use ibgs_testing::tiny_demo;
use ibgs_train::densify::{Observations, Plan, Reduction, Round, Strategy};
use ibgs_train::loss::{Loss, LossInputs};
use rand_chacha::ChaCha8Rng;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

/// Mean difference of a pixel and the one below it, by burn's own operations, of the last image that there is.
#[derive(Debug)]
struct Roughness {
    weight: f64,
}

impl Loss for Roughness {
    fn of(&self, inputs: &LossInputs<'_>) -> Result<Option<Tensor<1>>, GpuError> {
        let image = inputs.final_image.map_or(inputs.shown, |(image, _)| image).clone();
        let [height, _, _] = image.dims();
        let down = image.clone().narrow(0, 1, height - 1) - image.narrow(0, 0, height - 1);
        Ok(Some(down.abs().mean() * self.weight))
    }
}

/// A loss of burn's operations is one more of the gradients by an image: those of the batch are neither lost nor read too early.
#[test]
fn a_loss_of_burns_operations_counts_by_its_weight() {
    let dataset = dataset();
    let mut config = staged(30);
    config.deterministic = true;
    // It adds to the same sums as the warped sources, in an order that follows from the whole graph.
    config.surface.normal_weight = 0.0;
    let trained = |weight: Option<f64>| {
        let mut trainer = trainer(&dataset, &config);
        if let Some(weight) = weight {
            trainer.add_loss(Box::new(Roughness { weight }));
        }
        run(&mut trainer, 30);
        model(&trainer)
    };
    let usual = trained(None);
    assert!(trained(Some(0.0)) == usual, "a weight of zero changes nothing");
    let smooth = trained(Some(1.0));
    assert!(smooth.0 != usual.0 && smooth.1 != usual.1, "Gaussians and network learn from it");
    assert!(trained(Some(1.0)) == smooth, "the run repeats");
}

/// Notes the heights of the final images and of their photos.
#[derive(Debug)]
struct Heights(Arc<Mutex<Vec<[usize; 2]>>>);

impl Loss for Heights {
    fn of(&self, inputs: &LossInputs<'_>) -> Result<Option<Tensor<1>>, GpuError> {
        let heights = inputs.final_image.map(|(image, photo)| [image.dims()[0], photo.size[1] as usize]);
        self.0.lock().unwrap().extend(heights);
        Ok(None)
    }
}

/// Of the two bands of a view of 257 rows either has 129.
#[test]
fn the_final_image_is_of_a_band_of_the_view() {
    let cache = tempfile::tempdir().unwrap();
    let options = DemoOptions { width: 32, height: 257, views: 12, ..tiny_demo() };
    let dataset = ibgs_demo::load(&options, Some(cache.path()), &()).unwrap();
    let trained = |bands: u32| {
        let mut config = staged(24);
        config.deterministic = true;
        config.residual.bands = bands;
        let (mut trainer, heights) = (trainer(&dataset, &config), Arc::default());
        trainer.add_loss(Box::new(Heights(Arc::clone(&heights))));
        run(&mut trainer, 24);
        let heights = heights.lock().unwrap().clone();
        (heights, model(&trainer))
    };
    let ((whole, of_whole), (bands, of_bands)) = (trained(1), trained(2));
    assert_eq!(whole, [[257; 2]; 10]);
    assert_eq!(bands, [[129; 2]; 10]);
    assert!(of_bands.0 != of_whole.0 && of_bands.1 != of_whole.1, "Gaussians and network learn from the band");
    assert!(trained(2).1 == of_bands, "the run repeats");
}

/// Counts its rounds and changes nothing.
#[derive(Debug)]
struct Still(Arc<AtomicUsize>);

impl Strategy for Still {
    fn reduction(&self, _: &DensifyConfig, _: f64) -> Option<Reduction> {
        None
    }

    fn plan(&self, o: &Observations, _: &DensifyConfig, _: &Round<'_>, _: &mut ChaCha8Rng) -> Plan {
        self.0.fetch_add(1, Ordering::Relaxed);
        let mut plan = Plan::default();
        for i in 0..o.means.len() {
            plan.push(i as u32, o.means[i], o.log_scales[i], o.opacity_logits[i]);
        }
        plan
    }
}

#[test]
fn a_strategy_takes_the_rounds_of_the_one_that_the_options_name() {
    let (dataset, rounds) = (dataset(), Arc::new(AtomicUsize::new(0)));
    let mut trainer = trainer(&dataset, &densifying(45, 45));
    let first = trainer.splats().len();
    trainer.set_strategy(Box::new(Still(rounds.clone())), &dataset);
    run(&mut trainer, 45);
    assert_eq!((rounds.load(Ordering::Relaxed), trainer.splats().len()), (4, first));
}
