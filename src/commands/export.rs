//! `ibgs export`

use super::model::FileArgs;
use crate::progress::Bars;
use crate::stderr;
use anyhow::{Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::bundle::Bundle;
use ibgs_core::model::Model;
use ibgs_core::output::multi_view;
use ibgs_core::scene::{PlyFlavor, write_ply};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Example:
  ibgs export output/my-scene -o my-scene.ibgs";

/// Options of `ibgs export`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    model: FileArgs,
    /// File to write: `.ibgs` holds Gaussians, network, cameras and source photos; `.ply` holds the Gaussians only.
    #[arg(short, long)]
    output: PathBuf,
    /// Leave out the field `nd` of a PLY, which other programs do not know.
    #[arg(long)]
    plain: bool,
    /// Replace an existing file.
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
        return Ok(write_ply(&args.output, &args.model.read()?.gaussians, flavor)?);
    }
    if args.plain {
        bail!("a bundle has no plain form; leave `--plain` out, or choose a name in `.ply`");
    }
    let mut model = args.model.read()?;
    model.load_photos(&Bars::default())?;
    let network = model.network.as_deref().map(ibgs_core::residual::weights::to_bytes).transpose()?;
    if network.is_some() {
        model.training_photos()?;
    }
    let dataset = model.dataset(&Bars::default())?.clone();
    let field = model.exposure_field()?;
    let sources = multi_view::records(&dataset, &model.config.sources);
    let training = model.training_views();
    let names = || training.iter().map(|record| record.name.clone());
    let exposure = field.map(|field| names().zip(field.photos().iter().copied()).collect());
    let photo = |name: &str| dataset.views.iter().find(|v| v.name == name).map(|v| (v.name.clone(), v.photo.clone()));
    let photos = training.iter().filter_map(|record| photo(&record.name)).collect();
    let Model { config, cameras, iteration, gaussians, .. } = model;
    Bundle { iteration, gaussians, network, exposure, cameras, config, photos, sources }.write(&args.output)?;
    stderr!("{} written, {:.1} MB", args.output.display(), args.output.metadata()?.len() as f64 * 1e-6);
    Ok(())
}
