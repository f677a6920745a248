//! `ibgs prepare`

use crate::prepare::colmap::{Colmap, Matching};
use crate::prepare::tool::Tool;
use crate::prepare::{Preparation, Prepared, Request, is_video, listed};
use crate::progress::Bars;
use crate::signals::on_stop;
use crate::{stderr, stdout};
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::output::Existing;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const EXAMPLES: &str = "\
Examples:
  ibgs prepare photos -o my-scene               # a folder of photos
  ibgs prepare walk.mp4 -o my-scene --frames 200
  ibgs train my-scene --eval                    # what comes next";

const INSTALL_COLMAP: &str = "install COLMAP (Debian, Ubuntu: `apt install colmap`; macOS: `brew install colmap`; Windows: \
                              https://github.com/colmap/colmap/releases), or name it with `--colmap`";
const INSTALL_FFMPEG: &str = "install ffmpeg (Debian, Ubuntu: `apt install ffmpeg`; macOS: `brew install ffmpeg`; Windows: \
                              https://ffmpeg.org/download.html), or name it with `--ffmpeg`";

/// Fraction of photos with a pose below which something went wrong.
const FEW: f64 = 0.8;
/// Mean reprojection error in pixels over which poses are poor.
const LARGE_ERROR: f64 = 1.5;

/// Options of `ibgs prepare`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Folders of photos, and videos.
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Scene folder to make; a folder that was begun with the same inputs and options is continued.
    #[arg(short, long)]
    output: PathBuf,
    /// Most frames to take from each video, the sharpest, spread by how much the camera moves.
    #[arg(long, default_value_t = 150, value_parser = clap::value_parser!(u32).range(3..))]
    frames: u32,
    /// Which photos are compared with each other.
    #[arg(long, value_enum, default_value_t = Matching::Auto)]
    matching: Matching,
    /// COLMAP's model of the lens: `PINHOLE`, `SIMPLE_RADIAL`, `OPENCV`, `OPENCV_FISHEYE` and others.
    #[arg(long, default_value = "OPENCV")]
    camera_model: String,
    /// COLMAP's program.
    #[arg(long, default_value = "colmap")]
    colmap: PathBuf,
    /// ffmpeg's program; only videos need it.
    #[arg(long, default_value = "ffmpeg")]
    ffmpeg: PathBuf,
    /// Begin anew in a folder that was begun with other photos or options.
    #[arg(long)]
    overwrite: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let absolute = |path: &PathBuf| {
        if !path.exists() {
            bail!("{} does not exist", path.display());
        }
        std::path::absolute(path).with_context(|| format!("cannot find {}", path.display()))
    };
    let inputs = args.inputs.iter().map(absolute).collect::<Result<Vec<_>>>()?;
    let stop = Arc::new(AtomicBool::new(false));
    let asked = stop.clone();
    on_stop(move || asked.store(true, Ordering::Relaxed));
    let log = args.output.join("prepare.log");
    let colmap = Tool::new(args.colmap.clone(), INSTALL_COLMAP, log.clone(), stop.clone());
    let colmap = Colmap::new(colmap, &args.output)?;
    let ffmpeg = Tool::new(args.ffmpeg.clone(), INSTALL_FFMPEG, log, stop);
    if inputs.iter().any(|input| is_video(input)) {
        ffmpeg.output(&["-version"])?;
    }
    let (frames, camera_model) = (args.frames as usize, args.camera_model.clone());
    let request = Request { inputs, frames, camera_model, matching: args.matching };
    let bars = Bars::default();
    let existing = if args.overwrite { Existing::Replace } else { Existing::Keep };
    let preparation = Preparation::begin(&args.output, request, existing, &bars)?;
    let prepared = preparation.run(&colmap, &ffmpeg, &mut |note| stderr!("{note}"))?;
    tell(&args.output, &prepared);
    Ok(())
}

fn tell(scene: &Path, Prepared { photos, quality, unposed }: &Prepared) {
    stdout!(
        "{} of {photos} photos have a pose; mean reprojection error {:.2} pixels, {} points",
        quality.posed,
        quality.error,
        quality.points
    );
    if !unposed.is_empty() {
        stderr!("without a pose, and not used: {} of {photos} photos: {}", unposed.len(), listed(unposed));
    }
    if quality.models > 1 {
        stderr!(
            "warning: COLMAP found {} parts that do not connect; the scene is the largest of them. Photos between them would connect \
             them.",
            quality.models
        );
    }
    if (quality.posed as f64) < FEW * *photos as f64 {
        stderr!(
            "warning: many photos have no pose. More overlap helps: each part of the scene in three photos or more, small steps, no \
             blur; for photos in the order of a walk also `--matching sequential`. Then run it again with `--overwrite`."
        );
    }
    if quality.error > LARGE_ERROR {
        stderr!(
            "warning: the poses are not exact. Photos of one camera with one zoom help, or another `--camera-model` (a wide lens: \
             OPENCV_FISHEYE); run it again with `--overwrite`."
        );
    }
    stdout!("train on it: ibgs train {} --eval", scene.display());
}
