//! Trains with a densification strategy of its own: every round clones the tenth of the Gaussians that the views pull most, and
//! removes what has become transparent.
//!
//! ```sh
//! cargo run --release --example add_strategy -- output/tenths
//! ```

#![expect(clippy::print_stdout, reason = "an example")]

use ibgs_core::config::{self, DensifyConfig, TrainConfig};
use ibgs_core::gpu::{AdapterChoice, Gpu, Use};
use ibgs_core::output::log::TrainingProgress;
use ibgs_demo::DemoOptions;
use ibgs_train::Session;
use ibgs_train::densify::{FRESH, Observations, Over, Plan, Reduction, Round, Strategy};
use ibgs_train::session::{Observer, Output};
use rand_chacha::ChaCha8Rng;
use std::error::Error;
use std::ops::ControlFlow;
use std::path::PathBuf;

#[derive(Debug)]
struct Tenths;

impl Strategy for Tenths {
    fn reduction(&self, _: &DensifyConfig, _: f64) -> Option<Reduction> {
        Some(Reduction { over: Over::Sum, near_depth: 0.0 })
    }

    fn plan(&self, o: &Observations, config: &DensifyConfig, round: &Round<'_>, _: &mut ChaCha8Rng) -> Plan {
        let opacity = |i: usize| 1.0 / (1.0 + (-f64::from(o.opacity_logits[i])).exp());
        let lives = |&i: &usize| o.is_finite(i) && opacity(i) >= config.prune_opacity;
        let living: Vec<usize> = (0..o.means.len()).filter(lives).collect();
        // Mean norm of the gradient over the views that saw the Gaussian.
        let pull = |i: usize| o.statistics[i][0] / o.statistics[i][2].max(1.0);
        let mut pulled = living.clone();
        pulled.sort_by(|&a, &b| pull(b).total_cmp(&pull(a)));
        let room = (config.most() as usize).saturating_sub(living.len());
        let cloned = if round.grows { (living.len() / 10).min(room) } else { 0 };
        let mut plan = Plan { counts: [cloned, 0, o.means.len() - living.len()], ..Plan::default() };
        let kept = living.iter().map(|&i| (i, 0));
        for (i, fresh) in kept.chain(pulled[..cloned].iter().map(|&i| (i, FRESH))) {
            plan.push(i as u32 | fresh, o.means[i], o.log_scales[i], o.opacity_logits[i]);
        }
        plan
    }
}

/// Prints how many Gaussians there are.
struct Printer;

impl Observer for Printer {
    fn iteration(&mut self, progress: &TrainingProgress) -> ControlFlow<()> {
        if progress.iteration.is_multiple_of(20) {
            println!("{}: {} Gaussians", progress.iteration, progress.gaussians);
        }
        ControlFlow::Continue(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let output = std::env::args_os().nth(1).map(PathBuf::from).ok_or("give an output folder")?;
    let mut config = TrainConfig { iterations: Some(200), ..TrainConfig::default() };
    // Rounds and opacity resets come as with this one.
    config.densify.strategy = config::Strategy::Published;
    let dataset = ibgs_demo::load(&DemoOptions::small(), None, &())?;
    let gpu = Gpu::open(&AdapterChoice::Best, Use::Training)?;
    let session = Session::builder(config).dataset(dataset).output(Output::at(output)).checkpoint_every(None);
    session.strategy(Box::new(Tenths)).build(&gpu, &mut Printer)?.run(&mut Printer)?;
    Ok(())
}
