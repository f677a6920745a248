//! Trains a scene, prints how it goes, and ends early when the training photos are met well enough.
//!
//! ```sh
//! cargo run --release --example train_scene -- my-scene output/my-scene
//! ```

#![expect(clippy::print_stdout, reason = "an example")]

use ibgs_core::config::TrainConfig;
use ibgs_core::gpu::{AdapterChoice, Gpu, Use};
use ibgs_core::output::log::TrainingProgress;
use ibgs_train::Session;
use ibgs_train::session::{Event, Observer, Output};
use std::error::Error;
use std::ops::ControlFlow;
use std::path::PathBuf;

/// PSNR of the training photos, in dB, that is good enough.
const ENOUGH: f32 = 40.0;

/// Prints a line now and then, and everything that happens beside the iterations.
struct Printer;

impl Observer for Printer {
    fn iteration(&mut self, progress: &TrainingProgress) -> ControlFlow<()> {
        let TrainingProgress { iteration, iterations, stage, psnr, gaussians, .. } = progress;
        if iteration % 500 == 0 {
            println!("{iteration} of {iterations} ({stage}): {:.2} dB, {gaussians} Gaussians", psnr.unwrap_or(0.0));
        }
        if psnr.is_some_and(|psnr| psnr > ENOUGH) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn event(&mut self, event: &Event) {
        println!("{event}");
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let paths: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [scene, output] = &paths[..] else { return Err("give a scene folder and an output folder".into()) };
    let mut config = TrainConfig { iterations: Some(7_000), ..TrainConfig::default() };
    config.source = Some(std::path::absolute(scene)?);
    config.data.eval = true;
    let gpu = Gpu::open(&AdapterChoice::Best, Use::Training)?;
    let session = Session::builder(config).output(Output::at(output)).checkpoint_every(None);
    session.build(&gpu, &mut Printer)?.run(&mut Printer)?;
    Ok(())
}
