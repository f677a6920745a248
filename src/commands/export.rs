//! `ibgs export`

use super::model::FileArgs;
use crate::progress::Bars;
use crate::stderr;
use anyhow::{Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::model::is_bundle;
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
    args.model.read()?.into_bundle(&Bars::default())?.write(&args.output)?;
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
