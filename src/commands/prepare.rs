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
use ibgs_core::progress::Progress;
use ibgs_viewer::{PhotosRequest, Watch};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const EXAMPLES: &str = "\
Examples:
  ibgs prepare photos -o my-scene               # a folder of photos
  ibgs prepare walk.mp4 -o my-scene --frames 200
  ibgs train my-scene --eval                    # what comes next";

const INSTALL_COLMAP: &str = "install COLMAP (Debian, Ubuntu: `./setup.sh --photos` in the sources of ibgs, or `apt install colmap`; macOS: `brew install \
                              colmap`; Windows: https://github.com/colmap/colmap/releases), or name it with `--colmap`";
const INSTALL_FFMPEG: &str = "install ffmpeg (Debian, Ubuntu: `./setup.sh --photos` in the sources of ibgs, or `apt install ffmpeg`; macOS: `brew install \
                              ffmpeg`; Windows: https://ffmpeg.org/download.html), or name it with `--ffmpeg`";

/// Mean reprojection error in pixels over which poses are poor.
const LARGE_ERROR: f64 = 1.5;

/// The programs that a preparation needs.
#[derive(ClapArgs, Clone, Debug)]
pub struct Programs {
    /// COLMAP's program.
    #[arg(long, default_value = "colmap")]
    pub colmap: PathBuf,
    /// ffmpeg's program; only videos need it.
    #[arg(long, default_value = "ffmpeg")]
    pub ffmpeg: PathBuf,
}

impl Default for Programs {
    fn default() -> Self {
        Self { colmap: "colmap".into(), ffmpeg: "ffmpeg".into() }
    }
}

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
    #[command(flatten)]
    programs: Programs,
    /// Begin anew in a folder that was begun with other photos or options.
    #[arg(long)]
    overwrite: bool,
}

/// What a preparation reports to.
struct Listener<'a> {
    progress: &'a dyn Progress,
    /// Receives sentences for the user.
    note: &'a dyn Fn(String),
    /// Becomes true once it is to stop.
    stop: Arc<AtomicBool>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let scene = args.scene()?;
    args.make_on_terminal(&scene)?;
    stdout!("train on it: ibgs train {} --eval", scene.display());
    Ok(())
}

/// The scene of photos or a video, with the defaults of the command. It is made unless it is there, complete and of the same
/// photos.
pub fn scene_of(input: PathBuf) -> Result<PathBuf> {
    let args = Args::usual(input)?;
    let scene = args.scene()?;
    match args.is_made(&scene)? {
        Some(note) => stderr!("{note}"),
        None => args.make_on_terminal(&scene)?,
    }
    Ok(scene)
}

/// The same as the window asks for it.
pub fn scene_in_window(request: &PhotosRequest, programs: &Programs, watch: &Watch) -> Result<PathBuf> {
    let mut args = Args::usual(request.input.clone())?;
    (args.output, args.overwrite, args.programs) = (request.scene.clone(), request.anew, programs.clone());
    args.frames = request.frames.unwrap_or(args.frames);
    let scene = args.scene()?;
    // Other frames make another scene.
    match args.is_made(&scene)?.filter(|_| !request.anew && request.frames.is_none()) {
        Some(note) => watch.note(note),
        None => {
            let note = |sentence| watch.note(sentence);
            let prepared = args.make(&scene, &Listener { progress: watch, note: &note, stop: watch.stop() })?;
            watch.note(found(&prepared));
            warnings(&prepared).into_iter().for_each(note);
        }
    }
    Ok(scene)
}

impl Args {
    /// Those of an input alone.
    fn usual(input: PathBuf) -> Result<Self> {
        let command = Self::augment_args(clap::Command::new("prepare"));
        let words = ["prepare".into(), "--".into(), input.into_os_string()];
        Ok(Self::from_arg_matches(&command.try_get_matches_from(words)?)?)
    }

    /// Says so where the scene is there, complete and of the same photos.
    fn is_made(&self, scene: &Path) -> Result<Option<String>> {
        let is_made = is_complete(scene, &self.inputs()?)?;
        Ok(is_made.then(|| format!("{} was made of these photos and is used", scene.display())))
    }

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
    fn make_on_terminal(&self, scene: &Path) -> Result<()> {
        let stop = Arc::new(AtomicBool::new(false));
        let asked = stop.clone();
        on_stop(move || asked.store(true, Ordering::Relaxed));
        let note = |sentence| stderr!("{sentence}");
        let prepared = self.make(scene, &Listener { progress: &Bars::default(), note: &note, stop })?;
        stdout!("{}", found(&prepared));
        warnings(&prepared).into_iter().for_each(note);
        Ok(())
    }

    fn make(&self, scene: &Path, listener: &Listener<'_>) -> Result<Prepared> {
        let (inputs, stop) = (self.inputs()?, listener.stop.clone());
        let log = scene.join("prepare.log");
        let colmap = Tool::new(self.programs.colmap.clone(), INSTALL_COLMAP, log.clone(), stop.clone());
        let colmap = Colmap::new(colmap, scene, self.mapper)?;
        let ffmpeg = Tool::new(self.programs.ffmpeg.clone(), INSTALL_FFMPEG, log, stop);
        if inputs.iter().any(|input| is_video(input)) {
            ffmpeg.output(&["-version"])?;
        }
        let (frames, camera_model) = (self.frames as usize, self.camera_model.clone());
        let request = Request { inputs, frames, camera_model, matching: self.matching, mapper: self.mapper };
        let existing = if self.overwrite { Existing::Replace } else { Existing::Keep };
        let preparation = Preparation::begin(scene, request, existing, listener.progress)?;
        preparation.run(&colmap, &ffmpeg, &mut |sentence| (listener.note)(sentence))
    }
}

/// How good it is.
fn found(Prepared { photos, quality, .. }: &Prepared) -> String {
    format!(
        "{} of {photos} photos have a pose; mean reprojection error {:.2} pixels, {} points",
        quality.posed, quality.error, quality.points
    )
}

/// What is wrong with it.
fn warnings(Prepared { photos, quality, unposed }: &Prepared) -> Vec<String> {
    let mut warnings = Vec::new();
    if !unposed.is_empty() {
        let count = unposed.len();
        warnings.push(format!("without a pose, and not used: {count} of {photos} photos: {}", listed(unposed)));
    }
    if quality.models > 1 {
        warnings.push(format!(
            "warning: COLMAP found {} parts that do not connect; the scene is the largest of them. Photos between them would connect \
             them.",
            quality.models
        ));
    }
    if (quality.posed as f64) < ENOUGH * *photos as f64 {
        warnings.push(
            "warning: many photos have no pose. More overlap helps: each part of the scene in three photos or more, small steps, no \
             blur; for photos in the order of a walk also `--matching sequential`. Then run it again with `--overwrite`."
                .to_owned(),
        );
    }
    if quality.error > LARGE_ERROR {
        warnings.push(
            "warning: the poses are not exact. Photos of one camera with one zoom help, or another `--camera-model` (a wide lens: \
             OPENCV_FISHEYE); run it again with `--overwrite`."
                .to_owned(),
        );
    }
    warnings
}
