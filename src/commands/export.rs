//! `ibgs export`

use super::Model;
use super::model::{ModelArgs, gaussians, training};
use anyhow::{Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::bundle::Bundle;
use ibgs_core::scene::{PlyFlavor, write_ply};
use ibgs_core::tell;
use ibgs_core::train::output::multi_view;
use std::path::PathBuf;

/// Options of `ibgs export`.
#[derive(ClapArgs)]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// File to write: `.ibgs` is one file with Gaussians, network, cameras and source photos, `.ply` the Gaussians alone.
    #[arg(short, long)]
    output: PathBuf,
    /// Leave out of a PLY what other programs do not know.
    #[arg(long)]
    plain: bool,
    /// Replace a file that is there.
    #[arg(long)]
    overwrite: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    if args.output.exists() && !args.overwrite {
        bail!("{} is there already; choose another name or allow `--overwrite`", args.output.display());
    }
    let kind = args.output.extension().and_then(|e| e.to_str()).unwrap_or_default();
    if !matches!(kind, "ibgs" | "ply") {
        bail!("{} must end in `.ibgs` or `.ply`", args.output.display());
    }
    if kind == "ply" {
        let flavor = if args.plain { PlyFlavor::Plain } else { PlyFlavor::Full };
        return Ok(write_ply(&args.output, &gaussians(&args.model)?, flavor)?);
    }
    if args.plain {
        bail!("a bundle has no plain form; leave `--plain` out, or choose a name in `.ply`");
    }
    let mut model = Model::open(&args.model)?;
    // Not those on the device, which have been brought to local coordinates and rounded.
    let gaussians = gaussians(&args.model)?;
    let network = model.renderer.part().map(|part| part.network.to_values()).transpose()?;
    let network = network.map(|values| ibgs_core::residual::weights::to_bytes(&values)).transpose()?;
    let dataset = model.dataset(&args.model)?.clone();
    let sources = multi_view::records(&dataset, &model.config.sources);
    let training = training(&model.cameras);
    let names = || training.iter().map(|record| record.name.clone());
    let exposure = model.renderer.exposure().map(|field| names().zip(field.photos().iter().copied()).collect());
    let photo = |name: &str| dataset.views.iter().find(|v| v.name == name).map(|v| (v.name.clone(), v.photo.clone()));
    let photos = training.iter().filter_map(|record| photo(&record.name)).collect();
    let (config, cameras, iteration) = (model.config.clone(), model.cameras.clone(), model.iteration);
    Bundle { iteration, gaussians, network, exposure, cameras, config, photos, sources }.write(&args.output)?;
    tell!("{} written, {:.1} MB", args.output.display(), args.output.metadata()?.len() as f64 * 1e-6);
    Ok(())
}
