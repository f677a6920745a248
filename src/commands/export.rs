//! `ibgs export`

mod web;

use super::model::FileArgs;
use crate::progress::Bars;
use crate::stderr;
use anyhow::{Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::model::is_bundle;
use ibgs_core::scene::{Format, Gaussians, PlyFlavor, read_gaussians, write_gaussians, write_ply};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  ibgs export output/my-scene -o my-scene.ibgs
  ibgs export output/my-scene -o my-scene.spz
  ibgs export some.splat -o some.ply
  ibgs export output/my-scene --web my-page";

/// Options of `ibgs export`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    model: FileArgs,
    /// File to write: `.ibgs` holds Gaussians, network, cameras and source photos; `.ply`, `.compressed.ply`, `.spz`,
    /// `.splat`, `.glb` and `.sog` hold the Gaussians only, and for them MODEL may be a file of Gaussians too.
    #[arg(short, long, required_unless_present = "web")]
    output: Option<PathBuf>,
    /// Folder to write that a web server shows: the viewer for browsers, with the model and its source photos.
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["output", "plain"])]
    web: Option<PathBuf>,
    /// With `--web`: folder of the viewer's module for browsers (ibgs_web.js, ibgs_web_bg.wasm) [default: `web` beside
    /// the program].
    #[arg(long, value_name = "FOLDER", requires = "web")]
    module: Option<PathBuf>,
    /// Leave out the field `nd` of a PLY, which other programs do not know.
    #[arg(long)]
    plain: bool,
    /// Replace an existing file, or files of the same names in the folder.
    #[arg(long)]
    overwrite: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    match &args.web {
        Some(folder) => web::write(args, folder),
        None => file(args, args.output.as_ref().expect("one of both is required")),
    }
}

/// Writes the model as one file.
fn file(args: &Args, output: &Path) -> Result<()> {
    if output.exists() && !args.overwrite {
        bail!("{} is there already; choose another name or allow `--overwrite`", output.display());
    }
    if let Some(format) = Format::of_name(output) {
        return gaussians_alone(args, output, format);
    }
    if !is_bundle(output) {
        let endings: Vec<String> = Format::ALL.iter().map(|format| format!("`{}`", format.ending())).collect();
        bail!("{} must end in `.ibgs` or one of {}", output.display(), endings.join(", "));
    }
    if args.plain {
        bail!("a bundle has no plain form; leave `--plain` out, or choose a name in `.ply`");
    }
    args.model.read()?.into_bundle(&Bars::default())?.write(output)?;
    stderr!("{} written, {:.1} MB", output.display(), output.metadata()?.len() as f64 * 1e-6);
    Ok(())
}

/// Writes the Gaussians of a model, or of a file of them, and says what the format leaves out.
fn gaussians_alone(args: &Args, output: &Path, format: Format) -> Result<()> {
    if args.plain && format != Format::Ply {
        bail!("`--plain` is for files in `.ply`; leave it out");
    }
    let gaussians = gaussians(args)?;
    match format {
        Format::Ply if args.plain => write_ply(output, &gaussians, PlyFlavor::Plain)?,
        _ => write_gaussians(output, &gaussians, format)?,
    }
    for loss in format.losses(&gaussians) {
        stderr!("note: {}: {loss}", output.display());
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
