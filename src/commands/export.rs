//! `ibgs export`

use super::model::FileArgs;
use crate::progress::Bars;
use crate::stderr;
use anyhow::{Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::bundle::Bundle;
use ibgs_core::model::{Model, is_bundle};
use ibgs_core::output::multi_view;
use ibgs_core::scene::{Format, Gaussians, PlyFlavor, read_gaussians, write_gaussians, write_ply};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  ibgs export output/my-scene -o my-scene.ibgs
  ibgs export output/my-scene -o my-scene.spz
  ibgs export some.splat -o some.ply";

/// Options of `ibgs export`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    model: FileArgs,
    /// File to write: `.ibgs` holds Gaussians, network, cameras and source photos; `.ply`, `.compressed.ply`, `.spz`,
    /// `.splat`, `.glb` and `.sog` hold the Gaussians only, and for them MODEL may be a file of Gaussians too.
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
    if let Some(format) = Format::of_name(&args.output) {
        return gaussians_alone(args, format);
    }
    if !is_bundle(&args.output) {
        let endings: Vec<String> = Format::ALL.iter().map(|format| format!("`{}`", format.ending())).collect();
        bail!("{} must end in `.ibgs` or one of {}", args.output.display(), endings.join(", "));
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

/// Writes the Gaussians of a model, or of a file of them, and says what the format leaves out.
fn gaussians_alone(args: &Args, format: Format) -> Result<()> {
    if args.plain && format != Format::Ply {
        bail!("`--plain` is for files in `.ply`; leave it out");
    }
    let gaussians = gaussians(args)?;
    match format {
        Format::Ply if args.plain => write_ply(&args.output, &gaussians, PlyFlavor::Plain)?,
        _ => write_gaussians(&args.output, &gaussians, format)?,
    }
    for loss in format.losses(&gaussians) {
        stderr!("note: {}: {loss}", args.output.display());
    }
    Ok(())
}

fn gaussians(args: &Args) -> Result<Gaussians> {
    let path = &args.model.model;
    match path.is_file() && !is_bundle(path) {
        true => Ok(read_gaussians(path)?),
        false => Ok(args.model.read()?.gaussians),
    }
}
