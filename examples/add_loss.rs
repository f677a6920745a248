//! Adds a loss of its own to a training: neighbouring pixels of the base image shall have similar colours.
//!
//! ```sh
//! cargo run --release --example add_loss -- output/smooth
//! ```

#![expect(clippy::print_stdout, reason = "an example")]

use ibgs_core::config::TrainConfig;
use ibgs_core::gpu::{AdapterChoice, Gpu, GpuError, Use};
use ibgs_demo::DemoOptions;
use ibgs_train::Session;
use ibgs_train::burn::tensor::Tensor;
use ibgs_train::loss::{Loss, LossInputs};
use ibgs_train::session::{Event, Observer, Output};
use std::error::Error;
use std::path::PathBuf;

/// Total variation: `weight` times the mean absolute difference of neighbouring pixels, of either direction.
#[derive(Debug)]
struct Smoothness {
    weight: f64,
}

impl Loss for Smoothness {
    fn of(&self, inputs: &LossInputs<'_>) -> Result<Option<Tensor<1>>, GpuError> {
        // The surface losses keep the image smooth where they count.
        if inputs.schedule.surface_loss_at(inputs.iteration) {
            return Ok(None);
        }
        let image = inputs.shown.clone();
        let [height, width, _] = image.dims();
        let across = image.clone().narrow(1, 1, width - 1) - image.clone().narrow(1, 0, width - 1);
        let down = image.clone().narrow(0, 1, height - 1) - image.narrow(0, 0, height - 1);
        Ok(Some((across.abs().mean() + down.abs().mean()) * self.weight))
    }
}

/// Prints everything that happens beside the iterations.
struct Printer;

impl Observer for Printer {
    fn event(&mut self, event: &Event) {
        println!("{event}");
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let output = std::env::args_os().nth(1).map(PathBuf::from).ok_or("give an output folder")?;
    let config = TrainConfig { iterations: Some(200), ..TrainConfig::default() };
    let dataset = ibgs_demo::load(&DemoOptions::small(), None, &())?;
    let gpu = Gpu::open(&AdapterChoice::Best, Use::Training)?;
    let session = Session::builder(config).dataset(dataset).output(Output::at(output)).checkpoint_every(None);
    let session = session.loss(Box::new(Smoothness { weight: 0.01 }));
    session.build(&gpu, &mut Printer)?.run(&mut Printer)?;
    Ok(())
}
