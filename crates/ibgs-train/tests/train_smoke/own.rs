//! Losses and strategies that a program adds to a training.

use super::densifying;
use crate::small::{dataset, model, run, staged, trainer};
use burn::tensor::Tensor;
use ibgs_core::config::DensifyConfig;
use ibgs_core::gpu::GpuError;
use ibgs_train::densify::{Observations, Plan, Reduction, Round, Strategy};
use ibgs_train::loss::{Loss, LossInputs};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

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
