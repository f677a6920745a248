//! `ibgs prepare`

use crate::prepare::colmap::{Colmap, ENOUGH, Mapper, Matching};
use crate::prepare::tool::Tool;
use crate::prepare::{Preparation, Prepared, Request, is_complete, is_video, listed, scene_beside};
use crate::progress::Bars;
use crate::signals::on_stop;
use crate::{stderr, stdout};
use anyhow::{Context, Result, bail};
use clap::{Args as ClapArgs, FromArgMatches};
use ibgs_core::output::Existing;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const EXAMPLES: &str = "\
Examples:
  ibgs prepare photos -o my-scene               # a folder of photos
  ibgs prepare walk.mp4 -o my-scene --frames 200
  ibgs train my-scene --eval                    # what comes next";

const INSTALL_COLMAP: &str = "install COLMAP (Debian, Ubuntu: `./setup.sh --photos` in the sources of ibgs, or `apt install colmap`; macOS: `brew install \
                              colmap`; Windows: https://github.com/colmap/colmap/releases), or name it with `ibgs prepare --colmap`";
const INSTALL_FFMPEG: &str = "install ffmpeg (Debian, Ubuntu: `./setup.sh --photos` in the sources of ibgs, or `apt install ffmpeg`; macOS: `brew install \
                              ffmpeg`; Windows: https://ffmpeg.org/download.html), or name it with `ibgs prepare --ffmpeg`";

/// Mean reprojection error in pixels over which poses are poor.
const LARGE_ERROR: f64 = 1.5;

/// Options of `ibgs prepare`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Folders of photos, and videos.
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Scene folder to make; a folder that was begun with the same inputs and options is continued [default: beside the first
    /// input, with its name and `-scene`].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Most frames to take from each video, the sharpest, spread by how much the camera moves.
    #[arg(long, default_value_t = 150, value_parser = clap::value_parser!(u32).range(3..))]
    frames: u32,
    /// Which photos are compared with each other.
    #[arg(long, value_enum, default_value_t = Matching::Auto)]
    matching: Matching,
    /// What estimates the poses.
    #[arg(long, value_enum, default_value_t = Mapper::Auto)]
    mapper: Mapper,
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
    let scene = args.scene()?;
    args.make(&scene)?;
    stdout!("train on it: ibgs train {} --eval", scene.display());
    Ok(())
}

/// The scene of photos or a video, with the defaults of the command. It is made unless it is there, complete and of the same
/// photos.
pub fn scene_of(input: PathBuf) -> Result<PathBuf> {
    let command = Args::augment_args(clap::Command::new("prepare"));
    let words = ["prepare".into(), "--".into(), input.into_os_string()];
    let args = Args::from_arg_matches(&command.try_get_matches_from(words)?)?;
    let scene = args.scene()?;
    match is_complete(&scene, &args.inputs()?)? {
        true => stderr!("{} was made of these photos and is used", scene.display()),
        false => args.make(&scene)?,
    }
    Ok(scene)
}

impl Args {
    fn inputs(&self) -> Result<Vec<PathBuf>> {
        let absolute = |path: &PathBuf| {
            if !path.exists() {
                bail!("{} does not exist", path.display());
            }
            std::path::absolute(path).with_context(|| format!("cannot find {}", path.display()))
        };
        self.inputs.iter().map(absolute).collect()
    }

    fn scene(&self) -> Result<PathBuf> {
        match (&self.output, self.inputs.as_slice()) {
            (Some(scene), _) => Ok(scene.clone()),
            (None, [first, ..]) => scene_beside(first),
            (None, []) => bail!("there are no photos"),
        }
    }

    /// Makes the scene, and tells how good it is.
    fn make(&self, scene: &Path) -> Result<()> {
        let inputs = self.inputs()?;
        let stop = Arc::new(AtomicBool::new(false));
        let asked = stop.clone();
        on_stop(move || asked.store(true, Ordering::Relaxed));
        let log = scene.join("prepare.log");
        let colmap = Tool::new(self.colmap.clone(), INSTALL_COLMAP, log.clone(), stop.clone());
        let colmap = Colmap::new(colmap, scene, self.mapper)?;
        let ffmpeg = Tool::new(self.ffmpeg.clone(), INSTALL_FFMPEG, log, stop);
        if inputs.iter().any(|input| is_video(input)) {
            ffmpeg.output(&["-version"])?;
        }
        let (frames, camera_model) = (self.frames as usize, self.camera_model.clone());
        let request = Request { inputs, frames, camera_model, matching: self.matching, mapper: self.mapper };
        let bars = Bars::default();
        let existing = if self.overwrite { Existing::Replace } else { Existing::Keep };
        let preparation = Preparation::begin(scene, request, existing, &bars)?;
        tell(&preparation.run(&colmap, &ffmpeg, &mut |note| stderr!("{note}"))?);
        Ok(())
    }
}

fn tell(Prepared { photos, quality, unposed }: &Prepared) {
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
    if (quality.posed as f64) < ENOUGH * *photos as f64 {
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
}
