//! `ibgs export`

mod cameras;
mod web;

use super::model::FileArgs;
use crate::progress::Bars;
use crate::stderr;
use anyhow::{Result, bail};
use clap::{ArgGroup, Args as ClapArgs, FromArgMatches};
use ibgs_core::bundle::{Bundle, Packing};
use ibgs_core::files::is_same;
use ibgs_core::levels::write_streamed;
use ibgs_core::model::{Model, is_bundle};
use ibgs_core::scene::{
    Format, Gaussians, PlyFlavor, SpzVersion, read_gaussians, write_gaussians, write_ply, write_spz,
};
use ibgs_viewer::{ShareKind, ShareRequest};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  ibgs export output/my-scene -o my-scene.ibgs
  ibgs export output/my-scene -o my-scene.spz
  ibgs export some.splat -o some.ply
  ibgs export output/my-scene --web my-page
  ibgs export output/my-scene --streamed my-levels
  ibgs export output/my-scene --cameras sparse/0";

fn output_help() -> String {
    format!(
        "File to write: `.ibgs` holds Gaussians, network, cameras and source photos; {} hold the Gaussians only, and for them \
         MODEL may be a file of Gaussians too",
        Format::written_endings()
    )
}

/// Options of `ibgs export`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES, group = ArgGroup::new("target").required(true))]
pub struct Args {
    #[command(flatten)]
    model: FileArgs,
    #[arg(short, long, group = "target", help = output_help())]
    output: Option<PathBuf>,
    /// Folder to write that a web server shows: the viewer for browsers, with the model and its source photos.
    #[arg(long, value_name = "FOLDER", group = "target", conflicts_with = "plain")]
    web: Option<PathBuf>,
    /// Folder to write the cameras to, as a COLMAP model in text without points: those that the training saw, of photos without
    /// distortion in the size that they were trained in, refined where they were.
    #[arg(long, value_name = "FOLDER", group = "target", conflicts_with_all = ["plain", "levels", "quality", "photo_size"])]
    cameras: Option<PathBuf>,
    /// Folder to write streamed SOG to (`lod-meta.json`): the Gaussians in regions with levels of detail, of which PlayCanvas'
    /// and SuperSplat's viewers load what a view needs; for large models.
    #[arg(long, value_name = "FOLDER", group = "target", conflicts_with_all = ["plain", "levels", "quality", "photo_size"])]
    streamed: Option<PathBuf>,
    /// With `--web`: folder of the viewer's module for browsers (ibgs_web.js, ibgs_web_bg.wasm) [default: `web` beside
    /// the program].
    #[arg(long, value_name = "FOLDER", requires = "web")]
    module: Option<PathBuf>,
    #[command(flatten)]
    bundle: BundleArgs,
    /// For `.ibgs`: Gaussians in chunks with levels of detail, for a model that is larger than the memory of a GPU
    /// (`--gpu-memory` of `render` and `view`).
    #[arg(long, conflicts_with_all = ["web", "quality"])]
    levels: bool,
    /// Leave out the field `nd` of a PLY, which other programs do not know.
    #[arg(long)]
    plain: bool,
    /// For `.spz`: version of the format [default: 4]; programs from before 2026 read version 3.
    #[arg(long, value_name = "VERSION", value_parser = spz_version, conflicts_with_all = ["web", "cameras", "streamed"])]
    spz: Option<SpzVersion>,
    /// Replace an existing file, or files of the same names in the folder.
    #[arg(long)]
    overwrite: bool,
}

/// How a bundle is kept.
#[derive(ClapArgs)]
struct BundleArgs {
    /// For `.ibgs` and `--web`: JPEG quality of the photos, 1 to 100, with Gaussians as in a `.sog` file; or `lossless`
    /// [default: lossless, with `--web` 90].
    #[arg(long, value_name = "Q", value_parser = packing)]
    quality: Option<Packing>,
    /// For `.ibgs` and `--web`: longest side of the photos in pixels; larger ones are made smaller.
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(16..))]
    photo_size: Option<u32>,
}

fn packing(text: &str) -> Result<Packing, String> {
    match text.parse() {
        Ok(photo_quality @ 1..=100) => Ok(Packing::Small { photo_quality }),
        _ if text == "lossless" => Ok(Packing::Lossless),
        _ => Err("it is neither a whole number from 1 to 100 nor `lossless`".to_owned()),
    }
}

fn spz_version(text: &str) -> Result<SpzVersion, String> {
    match text {
        "3" => Ok(SpzVersion::V3),
        "4" => Ok(SpzVersion::V4),
        _ => Err("it is neither 3 nor 4".to_owned()),
    }
}

impl BundleArgs {
    fn packing(&self, usual: Packing) -> Packing {
        self.quality.unwrap_or(usual)
    }

    /// The model as a bundle; loads the scene where the model does not bring its photos.
    fn of(&self, model: Model) -> Result<Bundle> {
        let mut bundle = model.into_bundle(&Bars::default())?;
        if let Some(longest) = self.photo_size {
            bundle.shrink_photos(longest)?;
        }
        Ok(bundle)
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    write(args)?.iter().for_each(|line| stderr!("{line}"));
    Ok(())
}

/// Writes what is asked for; returns what to tell of it, a line each.
fn write(args: &Args) -> Result<Vec<String>> {
    match (&args.web, &args.cameras, &args.streamed) {
        (Some(folder), ..) => Ok(vec![web::write(args, folder)?]),
        (_, Some(folder), _) => Ok(vec![cameras::write(args, folder)?]),
        (.., Some(folder)) => streamed(args, folder),
        _ => file(args, args.output.as_ref().expect("one of the four is required")),
    }
}

/// The same as the window asks for it, of a model that was opened as `files` say.
///
/// # Errors
/// A name that does not fit, something that is there already, and those of the command.
pub fn shared(request: &ShareRequest, files: FileArgs) -> Result<Vec<String>> {
    let path = request.target.display();
    if is_same(&request.target, &request.model) {
        bail!("{path} is the model itself; choose another name");
    }
    let fits = match request.kind {
        ShareKind::Page => true,
        ShareKind::Bundle => is_bundle(&request.target),
        ShareKind::Gaussians(format) => Format::of_name(&request.target) == Some(format),
    };
    if !fits {
        bail!("the name of {path} must end in `{}`", request.kind.ending());
    }
    if !request.replaces && refuse_taken(&request.target, false).is_err() {
        bail!("{path} is there already; choose another name, or allow to replace it");
    }
    let target = if request.kind == ShareKind::Page { "--web=" } else { "--output=" };
    let mut target = OsString::from(target);
    target.push(&request.target);
    let mut words = vec!["export".into(), target];
    words.extend(request.replaces.then(|| "--overwrite".into()));
    words.extend((request.kind == ShareKind::Bundle && request.is_small).then(|| "--quality=90".into()));
    words.extend(["--".into(), request.model.clone().into_os_string()]);
    let command = Args::augment_args(clap::Command::new("export"));
    let args = Args::from_arg_matches(&command.try_get_matches_from(words)?)?;
    write(&Args { model: files, ..args })
}

/// Refuses a folder in which there is something.
fn refuse_taken(folder: &Path, overwrite: bool) -> Result<()> {
    let taken = folder.read_dir().is_ok_and(|mut entries| entries.next().is_some()) || folder.is_file();
    if taken && !overwrite {
        bail!("{} is not empty; choose another folder or allow `--overwrite`", folder.display());
    }
    Ok(())
}

/// Writes the model as one file.
fn file(args: &Args, output: &Path) -> Result<Vec<String>> {
    if output.exists() && !args.overwrite {
        bail!("{} is there already; choose another name or allow `--overwrite`", output.display());
    }
    let format = Format::of_name(output);
    if args.spz.is_some() && format != Some(Format::Spz) {
        bail!("`--spz` is for files in `.spz`; leave it out");
    }
    if let Some(format) = format {
        if args.bundle.quality.is_some() || args.bundle.photo_size.is_some() || args.levels {
            bail!(
                "`--quality`, `--photo-size` and `--levels` are for bundles; leave them out, or choose a name in `.ibgs`"
            );
        }
        return gaussians_alone(args, output, format);
    }
    if !is_bundle(output) {
        bail!("{} must end in `.ibgs` or one of {}", output.display(), Format::written_endings());
    }
    if args.plain {
        bail!("a bundle has no plain form; leave `--plain` out, or choose a name in `.ply`");
    }
    let usual = if args.levels { Packing::Levels } else { Packing::Lossless };
    args.bundle.of(args.model.read()?)?.write(output, args.bundle.packing(usual))?;
    Ok(vec![said(output)?])
}

/// Writes the Gaussians of a model, or of a file of them, and says what the format leaves out.
fn gaussians_alone(args: &Args, output: &Path, format: Format) -> Result<Vec<String>> {
    if args.plain && format != Format::Ply {
        bail!("`--plain` is for files in `.ply`; leave it out");
    }
    let gaussians = gaussians(args)?;
    match format {
        Format::Ply if args.plain => write_ply(output, &gaussians, PlyFlavor::Plain)?,
        Format::Spz => write_spz(output, &gaussians, args.spz.unwrap_or_default())?,
        _ => write_gaussians(output, &gaussians, format)?,
    }
    let said = said(output)?;
    Ok(noted(&gaussians, format, output, said))
}

/// What a format leaves out of a model, and last what else is to be told.
fn noted(gaussians: &Gaussians, format: Format, output: &Path, last: String) -> Vec<String> {
    let notes = format.losses(gaussians).into_iter().map(|loss| format!("note: {}: {loss}", output.display()));
    notes.chain([last]).collect()
}

/// Writes the Gaussians with levels of detail.
fn streamed(args: &Args, folder: &Path) -> Result<Vec<String>> {
    refuse_taken(folder, args.overwrite)?;
    let gaussians = gaussians(args)?;
    let counts = write_streamed(folder, &gaussians)?;
    let counts: Vec<String> = counts.iter().map(usize::to_string).collect();
    let last = format!("{} written, Gaussians of each level of detail: {}", folder.display(), counts.join(", "));
    Ok(noted(&gaussians, Format::SogFolder, folder, last))
}

/// Says that the file is there, and its size.
fn said(output: &Path) -> Result<String> {
    Ok(format!("{} written, {:.1} MB", output.display(), output.metadata()?.len() as f64 * 1e-6))
}

fn gaussians(args: &Args) -> Result<Gaussians> {
    let path = &args.model.model;
    match path.is_file() && !is_bundle(path) {
        true => Ok(read_gaussians(path)?),
        false => {
            let mut model = args.model.read()?;
            model.expand()?;
            Ok(model.gaussians)
        }
    }
}
