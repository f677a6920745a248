//! `ibgs train`

pub mod block;
pub mod demo;
mod json_log;
mod options;
mod pace;
mod photos;
mod stages;
mod start;
mod terminal;
mod window;

pub use demo::DemoDefaults;
pub use start::{Reports, prepare, requested};
pub use window::{Failure, Watched};

use super::{open_gpu, strategy, view, word};
use crate::advice::resolution;
use crate::stderr;
use anyhow::{Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::blocks::PlanFolder;
use ibgs_core::config::{Background, Method, Preset, Strategy, TrainConfig};
use ibgs_core::dataset::{Alpha, ColorSpace, InitialPoints, Masks, PrincipalPoint, Resampler, Resolution};
use ibgs_core::gpu::Use;
use ibgs_core::sources::memory::MemoryBudget;
use ibgs_train::Session;
use ibgs_train::session::{JsonLines, SessionBuilder};
use json_log::Before;
use options::{minutes, splats};
use stages::StageArgs;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Headings of `ibgs train --help`, in their order there.
mod heading {
    pub const SCENE: &str = "Scene";
    pub const OUTPUT: &str = "Output";
    pub const LENGTH: &str = "Training length";
    pub const EVALUATION: &str = "Evaluation and saving";
    pub const GAUSSIANS: &str = "Gaussians";
    pub const IMAGE_BASED: &str = "Image-based part";
    pub const DEVICE: &str = "Device and memory";
}

const EXAMPLES: &str = "\
Examples:
  ibgs train my-scene --eval --preset fast       # short run with evaluation
  ibgs train photos --prepare                    # photos without poses
  ibgs train --resume -m output/my-scene         # resume a stopped training";

/// Options of `ibgs train`; they override the options file.
// `[default: ...]` in these texts repeats the defaults of `TrainConfig`, `Schedule` and `Session::builder`.
#[derive(ClapArgs, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Scene folder (photos with their poses, of COLMAP, transforms.json or another program) or a .zip of one [default: the
    /// built-in demo scene].
    scene: Option<PathBuf>,

    /// What to train: `ibgs` (Gaussians and a residual from neighbouring photos) or `3dgs` (plain 3D Gaussian splatting)
    /// [default: ibgs].
    #[arg(long, value_parser = word::<Method>())]
    method: Option<Method>,
    /// Options to begin with, which the others override: `default`; `best` (two networks and six bases, in about four times the
    /// default's time); `fast` (6000 iterations with the network at half size, about half a minute on a fast GPU);
    /// `published` (those of the published experiments) [default: default].
    #[arg(
        long,
        value_parser = word::<Preset>(),
        conflicts_with_all = ["config", "resume", "init"]
    )]
    preset: Option<Preset>,
    /// Options file (TOML), such as the `config.toml` of an earlier run; the command line overrides it.
    #[arg(long)]
    config: Option<PathBuf>,
    /// Resume the stopped training in the output folder `--model`, with its options.
    #[arg(long, requires = "model", conflicts_with_all = ["overwrite", "config", "init"])]
    resume: bool,
    /// Train this block of a scene that `ibgs split` has cut, counted from 0; SCENE is then the folder of the plan. A stopped
    /// training is resumed, and nothing is done for a block that is trained.
    #[arg(
        long,
        value_name = "N",
        requires = "scene",
        conflicts_with_all = ["preset", "config", "resume", "model", "init"]
    )]
    block: Option<u32>,
    /// The options to begin with, for a block.
    #[arg(skip)]
    base: Option<TrainConfig>,
    /// Where SCENE is a folder of photos or a video, estimate the camera poses first, as `ibgs prepare SCENE` does; a scene
    /// that was made so is used again while the photos stay the same.
    #[arg(long, conflicts_with_all = ["block", "resume", "images"])]
    prepare: bool,
    /// Train in the viewer's window; closing it stops the training as Ctrl-C does.
    #[arg(long)]
    with_viewer: bool,
    /// Seed of view order and sampling [default: 0].
    #[arg(long)]
    seed: Option<u64>,
    /// Number of bases, trained side by side, whose mean is the base image: more true to the scene, at more time and memory
    /// [default: 2, and 1 with `--init`, `--method 3dgs`, another `--densify`, photos with alpha, or a software adapter].
    #[arg(long, value_name = "N")]
    ensemble: Option<u32>,
    /// Repeat bit for bit on the same adapter and build, resumed or not; checkpoints are larger.
    #[arg(long)]
    deterministic: bool,

    /// The same as SCENE.
    #[arg(short, long, conflicts_with = "scene", help_heading = heading::SCENE)]
    source: Option<PathBuf>,
    /// Photo folder inside the scene, `.` for the scene folder itself [default: images, or images_N with `-r N` where it exists].
    #[arg(short, long, help_heading = heading::SCENE)]
    images: Option<String>,
    /// Divide the photos' size by 1, 2, 4 or 8; a larger number is their width in pixels [default: 1].
    #[arg(short, long, value_parser = resolution, allow_negative_numbers = true, help_heading = heading::SCENE)]
    resolution: Option<Resolution>,
    /// Largest width or height of a photo in pixels; larger photos are reduced [default: no limit].
    #[arg(long, help_heading = heading::SCENE)]
    max_resolution: Option<u32>,
    /// Filter that reduces photos; `bicubic` is that of the published code [default: lanczos3].
    #[arg(long, value_parser = word::<Resampler>(), help_heading = heading::SCENE)]
    resampler: Option<Resampler>,
    /// Principal point: `true` (the scene's own) or `centred` (the image centre, as the published code assumes)
    /// [default: true].
    #[arg(long, value_parser = word::<PrincipalPoint>(), help_heading = heading::SCENE)]
    principal_point: Option<PrincipalPoint>,
    /// Meaning of masked pixels (in `masks/` or alpha channels): `ignore` (they do not count) or `object` (they are empty
    /// space) [default: object where the masks leave one object in each photo, ignore in others].
    #[arg(long, value_parser = word::<Masks>(), help_heading = heading::SCENE)]
    masks: Option<Masks>,
    /// Meaning of transparent pixels: `mask` (they are masked) or `composite` (they are empty, over the background); `keyed`: the
    /// photos have none and lie on one colour, which is empty [default: composite in Blender scenes, keyed where all photos
    /// lie on one colour, mask in others and with `--masks object`].
    #[arg(long, value_parser = word::<Alpha>(), help_heading = heading::SCENE)]
    alpha: Option<Alpha>,
    /// Encoding of the photos' values: `srgb` or `linear` [default: linear in EXR files, srgb in others].
    #[arg(long, value_parser = word::<ColorSpace>(), help_heading = heading::SCENE)]
    color_space: Option<ColorSpace>,
    /// Colour behind the Gaussians: `white`, `black`, `R,G,B`, or `random` (another one in each iteration, black in rendered
    /// views). Photos of an object are always trained over random colours [default: white in Blender scenes, the photos' own
    /// where all lie on one colour, black in others].
    #[arg(long, value_name = "COLOUR", help_heading = heading::SCENE)]
    background: Option<Background>,
    /// The same as `--background white`.
    #[arg(long, conflicts_with = "background", help_heading = heading::SCENE)]
    white_background: bool,
    /// What the training begins with: `auto` (the scene's points and those found in the photos), `scene` (the scene's alone),
    /// `photos` (points where photos agree on a depth, or in the visual hull of an object; also where the scene has none) or
    /// `random` [default: auto].
    #[arg(
        long,
        value_name = "FROM",
        value_parser = word::<InitialPoints>(),
        help_heading = heading::SCENE
    )]
    initial_points: Option<InitialPoints>,
    /// Leave out points of a COLMAP model that have a reprojection error over 2 pixels or are seen in fewer than 3
    /// photos.
    #[arg(long, help_heading = heading::SCENE)]
    filter_points: bool,

    /// Output folder [default: output/NAME, or the first free output/NAME-2, -3 ...].
    #[arg(short, long, help_heading = heading::OUTPUT)]
    model: Option<PathBuf>,
    /// Replace the model that the output folder holds, and the file of `--log-json`.
    #[arg(long, help_heading = heading::OUTPUT)]
    overwrite: bool,
    /// Also write the progress of the training to this file, a JSON record a line; `--resume` appends to it.
    #[arg(long, value_name = "FILE", help_heading = heading::OUTPUT)]
    log_json: Option<PathBuf>,

    /// Number of iterations; defaults marked `scaled` are for 30000 and follow it in proportion [default: with two bases 130 for
    /// each training photo, 5000 to 11000, otherwise, and for photos with alpha, 200, 7000 to 30000; with another `--densify` or
    /// without scaling 30000; with `--init` 3000; demo scene 10000, on a software adapter 200].
    #[arg(long, alias = "total-train-iters", help_heading = heading::LENGTH)]
    iterations: Option<u32>,
    /// Do not scale: keep the milestones of a run of 30000 iterations.
    #[arg(long, help_heading = heading::LENGTH)]
    no_schedule_scaling: bool,

    /// Hold out every Nth photo (by name) for evaluation, and measure on it; N is `--eval-split-every`.
    #[arg(long, help_heading = heading::EVALUATION)]
    eval: bool,
    /// N of `--eval`, at least 2; implies `--eval` [default: 8].
    #[arg(long, help_heading = heading::EVALUATION)]
    eval_split_every: Option<u32>,
    /// Iterations to evaluate at, besides the last; separated by commas [default: 7000, scaled].
    #[arg(long, value_delimiter = ',', help_heading = heading::EVALUATION)]
    eval_iterations: Option<Vec<u32>>,
    /// Also evaluate every N iterations; 0: never [default: 0].
    #[arg(long, help_heading = heading::EVALUATION)]
    eval_every: Option<u32>,
    /// Iterations to save the model at, besides the last; separated by commas [default: 7000, scaled].
    #[arg(long, value_delimiter = ',', help_heading = heading::EVALUATION)]
    save_iterations: Option<Vec<u32>>,
    /// Minutes between two checkpoints; 0: only when the training stops.
    #[arg(
        long,
        value_name = "MINUTES",
        default_value_t = 2.0,
        value_parser = minutes,
        help_heading = heading::EVALUATION
    )]
    checkpoint_every: f64,

    /// Start from a file of Gaussians of this scene (`.ply` and others) or from a model, whose bases become one; train surface
    /// and residual, without densification.
    #[arg(long, value_name = "FILE|MODEL", help_heading = heading::GAUSSIANS)]
    init: Option<PathBuf>,
    /// Largest number of Gaussians, such as `500000`, `500k` or `1.5M` [default: one per 45 pixels of the training photos,
    /// from 200000 to 3000000, with `default`, else by the strategy; demo scene 1000000, on a software adapter 12000].
    #[arg(long, value_parser = splats, help_heading = heading::GAUSSIANS)]
    max_splats: Option<u32>,
    /// Degree of the spherical harmonics (view dependence of the base colour), 0 to 3 [default: 2; with
    /// `--method 3dgs`, and for objects, 3; with `--init` that of its file].
    #[arg(long, conflicts_with = "init", help_heading = heading::GAUSSIANS)]
    sh_degree: Option<u32>,
    /// Iterations until the degree of the spherical harmonics in use rises by one [default: 1000, scaled; with `--init`
    /// 1].
    #[arg(long, help_heading = heading::GAUSSIANS)]
    sh_interval: Option<u32>,
    /// Iterations over which the learning rate of the positions falls [default: 30000, scaled].
    #[arg(long, help_heading = heading::GAUSSIANS)]
    mean_iterations: Option<u32>,
    /// How Gaussians are added and removed [default: default].
    #[arg(
        long,
        value_name = "STRATEGY",
        value_parser = strategy(),
        help_heading = heading::GAUSSIANS
    )]
    densify: Option<Strategy>,
    /// The first densification comes after this iteration [default: 500, less in short runs].
    #[arg(long, help_heading = heading::GAUSSIANS)]
    densify_start: Option<u32>,
    /// Gaussians are added only before this iteration [default: 21000 with `default`, else by the strategy; scaled; with
    /// `--init` none are added].
    #[arg(long, help_heading = heading::GAUSSIANS)]
    densify_end: Option<u32>,
    /// Iterations between two densifications [default: 200 with `default`, else by the strategy; less in short
    /// runs].
    #[arg(long, help_heading = heading::GAUSSIANS)]
    densify_interval: Option<u32>,
    /// Iterations between two opacity resets of the strategies that have them [default: 3000, scaled].
    #[arg(long, help_heading = heading::GAUSSIANS)]
    opacity_reset_interval: Option<u32>,

    #[command(flatten)]
    stages: StageArgs,

    /// Device memory that the training may take: `auto` (nine tenths of what other programs leave), `none` (no limit),
    /// or a size such as `6GiB`; the number of Gaussians stops growing there.
    #[arg(long, default_value = "auto", help_heading = heading::DEVICE)]
    gpu_memory: MemoryBudget,
    /// Adapter by number or part of its name; `ibgs info` lists them [default: the most capable].
    #[arg(long, help_heading = heading::DEVICE)]
    adapter: Option<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    if let Some(number) = args.block {
        return block::train(args, number);
    }
    if let Some(path) = args.scene.as_ref().filter(|path| PlanFolder::at(path).holds_plan()) {
        let path = path.display();
        bail!("{path} is a plan of blocks; train one of them (`--block 0`), or all (`ibgs suite {path}`)");
    }
    run_whole(args, Before::of(args.resume, args.overwrite))
}

fn run_whole(args: &Args, before: Before) -> Result<()> {
    if args.with_viewer {
        view::check_display(None)?;
    }
    if let Some(path) = &args.log_json {
        json_log::check(path, before)?;
    }
    let training = if args.prepare { photos::prepared(args)?.training()? } else { args.training()? };
    let mut session = start(training, args.adapter.as_ref())?;
    let log = args.log_json.as_deref().map(|path| log(&session, path, before)).transpose()?;
    match args.with_viewer {
        true => view::look(view::Opener::default(), |failure| Watched::new(session, failure).with_log(log)),
        false => {
            terminal::train(&mut session, log)?;
            if let Some(folder) = session.folder().filter(|_| session.is_done()) {
                stderr!("`ibgs view {}` shows it", folder.root().display());
            }
            Ok(())
        }
    }
}

/// Trains to the end, with progress on the terminal.
pub fn train(training: SessionBuilder, adapter: Option<&String>) -> Result<()> {
    terminal::train(&mut start(training, adapter)?, None)
}

fn start(training: SessionBuilder, adapter: Option<&String>) -> Result<Session> {
    prepare(training.command(command_line()), || open_gpu(adapter, Use::Training), &|_| {})
}

/// Opens the log of a training, and notes that it starts.
fn log(session: &Session, path: &Path, before: Before) -> Result<JsonLines<File>> {
    let mut log = JsonLines::new(json_log::open(path, before)?, session.gpu().clone());
    log.start(&session.progress());
    Ok(log)
}

/// How this program was called, as a shell reads it.
fn command_line() -> String {
    let arguments: Vec<String> = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    // No argument holds the zero byte that it refuses.
    let quoted = shlex::try_join(arguments.iter().map(String::as_str)).unwrap_or_else(|_| arguments.join(" "));
    format!("ibgs {quoted}")
}
