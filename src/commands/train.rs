//! `ibgs train`

mod estimate;
mod plan;
mod resume;
mod stages;
mod terminal;
mod window;

pub use plan::Plan;
pub use window::Watched;

use super::{open_gpu, view};
use anyhow::Result;
use clap::Args as ClapArgs;
use ibgs_core::config::{Method, Strategy, TrainConfig};
use ibgs_core::dataset::{Alpha, ColorSpace, Masks};
use ibgs_core::sources::memory::MemoryBudget;
use plan::DemoGiven;
use stages::StageArgs;
use std::path::PathBuf;
use std::time::Duration;

/// Iterations of a run that begins with a finished model, when none are asked for.
const WARM_ITERATIONS: u32 = 3_000;

/// Options of `ibgs train`; what is given here overrides the options file.
#[derive(ClapArgs, Clone, Debug)]
pub struct Args {
    /// Scene folder (COLMAP model with photos, or transforms.json) or a .zip of one; left out: the built-in demo scene.
    scene: Option<PathBuf>,
    /// The same as SCENE.
    #[arg(short, long, conflicts_with = "scene")]
    source: Option<PathBuf>,
    /// Output folder [default: output/NAME, or the first free output/NAME-2, -3 ...].
    #[arg(short, long)]
    model: Option<PathBuf>,
    /// Train into an output folder that already holds a model, and remove that model.
    #[arg(long)]
    overwrite: bool,
    /// Options file (TOML), as an earlier run wrote it.
    #[arg(long)]
    config: Option<PathBuf>,
    /// What to train: `ibgs` with a residual from neighbouring photos; `3dgs` is plain 3D Gaussian splatting.
    #[arg(long, value_parser = ["ibgs", "3dgs"])]
    method: Option<String>,
    /// Divide the photos by 1, 2, 4 or 8, or resize them to a width in pixels.
    #[arg(short, long)]
    resolution: Option<String>,
    /// How photos are made smaller; `bicubic` is the published code's way.
    #[arg(long, value_parser = ["lanczos3", "bicubic"])]
    resampler: Option<String>,
    /// Photo folder inside the scene.
    #[arg(short, long)]
    images: Option<String>,
    /// Longest side that a photo may have, in pixels.
    #[arg(long)]
    max_resolution: Option<u32>,
    /// Hold every 8th photo out and measure on it.
    #[arg(long)]
    eval: bool,
    /// Hold every so-manieth photo out.
    #[arg(long)]
    eval_split_every: Option<u32>,
    /// `true`: the scene's own principal point; `centred`: the image centre, as the published code assumes.
    #[arg(long, value_parser = ["true", "centred"])]
    principal_point: Option<String>,
    /// What lies outside of the masks, in `masks/` or alpha channels: `ignore`: anything, it does not count; `object`: nothing
    /// [default: ignore].
    #[arg(long)]
    masks: Option<Masks>,
    /// `mask`: transparent pixels of photos do not count; `composite`: the photos lie over the background colour
    /// [default: composite in Blender scenes, mask in others and with `--masks object`].
    #[arg(long)]
    alpha: Option<Alpha>,
    /// Values of the photos: `srgb` as they are, `linear` light [default: linear in EXR files, srgb in others].
    #[arg(long)]
    color_space: Option<ColorSpace>,
    /// Leave out points of a COLMAP model with a reprojection error over 2 pixels or fewer than 3 images.
    #[arg(long)]
    filter_points: bool,
    /// Number of iterations; the milestones follow.
    #[arg(long, alias = "total-train-iters")]
    iterations: Option<u32>,
    /// Keep the milestones of a 30,000-iteration run whatever `--iterations` says.
    #[arg(long)]
    no_schedule_scaling: bool,
    /// Degree of the spherical harmonics, 0 to 3; with `--init` that of its file.
    #[arg(long, conflicts_with = "init")]
    sh_degree: Option<u32>,
    /// Begin with the Gaussians of a PLY file of this scene, and train in short what goes beyond them.
    #[arg(long)]
    init: Option<PathBuf>,
    /// Iterations between two steps of the spherical-harmonics degree.
    #[arg(long)]
    sh_interval: Option<u32>,
    /// Iterations of the position learning-rate schedule.
    #[arg(long)]
    mean_iterations: Option<u32>,
    /// First densification comes after this iteration.
    #[arg(long)]
    densify_start: Option<u32>,
    /// Last densification comes before this iteration.
    #[arg(long)]
    densify_end: Option<u32>,
    /// Iterations between two densifications.
    #[arg(long)]
    densify_interval: Option<u32>,
    /// How Gaussians are added and removed: `published` as in the paper, with opacity resets; `absgs` splits by absolute gradients;
    /// `mcmc` moves them and grows to `--max-splats`.
    #[arg(long, value_name = "STRATEGY", value_parser = ["default", "published", "absgs", "mcmc"])]
    densify: Option<String>,
    /// Iterations between two opacity resets.
    #[arg(long)]
    opacity_reset_interval: Option<u32>,
    /// Most Gaussians.
    #[arg(long)]
    max_splats: Option<u32>,
    /// Device memory that the training may take: `auto` (nine tenths of what other programs leave of it), `none` (no limit),
    /// or a size such as `6GiB`; the number of Gaussians stops growing there.
    #[arg(long, default_value = "auto")]
    gpu_memory: MemoryBudget,
    /// Evaluate every so many iterations.
    #[arg(long)]
    eval_every: Option<u32>,
    /// Evaluate at these iterations besides the last.
    #[arg(long, value_delimiter = ',')]
    eval_iterations: Option<Vec<u32>>,
    /// Save the model at these iterations besides the last.
    #[arg(long, value_delimiter = ',')]
    save_iterations: Option<Vec<u32>>,
    /// Seed of view order and sampling.
    #[arg(long)]
    seed: Option<u64>,
    /// White in place of black behind the Gaussians.
    #[arg(long)]
    white_background: bool,
    #[command(flatten)]
    stages: StageArgs,
    /// Go on with the training that was stopped in the output folder `--model`, with its options.
    #[arg(long, requires = "model", conflicts_with_all = ["overwrite", "config", "init"])]
    resume: bool,
    /// Minutes between two checkpoints, from which `--resume` goes on; 0: only when the training is stopped.
    #[arg(long, value_name = "MINUTES", default_value_t = 2.0, value_parser = minutes)]
    checkpoint_every: f64,
    /// Repeat bit for bit on the same adapter, also where the run is resumed; checkpoints are larger.
    #[arg(long)]
    deterministic: bool,
    /// Train in the viewer's window; closing it ends the training as Ctrl-C does.
    #[arg(long)]
    with_viewer: bool,
    /// Adapter by number or part of its name; `ibgs info` lists them.
    #[arg(long)]
    adapter: Option<String>,
}

/// Up to a year.
fn minutes(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(minutes) if (0.0..=525_600.0).contains(&minutes) => Ok(minutes),
        _ => Err("give a number of minutes, 0 or above".to_owned()),
    }
}

fn set<T>(slot: &mut T, value: &Option<T>)
where
    T: Clone,
{
    if let Some(value) = value {
        *slot = value.clone();
    }
}

fn set_some<T: Clone>(slot: &mut Option<T>, value: &Option<T>) {
    if value.is_some() {
        slot.clone_from(value);
    }
}

impl Args {
    /// The training that is asked for.
    fn plan(&self) -> Result<Plan> {
        let resumed =
            self.model.as_deref().filter(|_| self.resume).map(|path| resume::checkpoint(self, path)).transpose()?;
        let config = match &resumed {
            Some(checkpoint) => checkpoint.config.clone(),
            None => self.config()?,
        };
        Ok(Plan {
            resumed,
            model: self.model.clone(),
            overwrite: self.overwrite,
            gpu_memory: self.gpu_memory,
            checkpoint_every: (self.checkpoint_every > 0.0)
                .then(|| Duration::from_secs_f64(60.0 * self.checkpoint_every)),
            // An options file counts in full: one that an earlier run wrote must give that run again.
            demo: self.config.is_none().then_some(DemoGiven {
                iterations: self.iterations,
                max_splats: self.max_splats,
                residual_factor: self.stages.residual_factor,
            }),
            ..Plan::new(config)
        })
    }

    /// The options file with the command line on top.
    fn config(&self) -> Result<TrainConfig> {
        let c = self.config.as_deref().map_or_else(|| Ok(TrainConfig::default()), TrainConfig::load)?;
        self.over(c)
    }

    /// The command line on top of options.
    fn over(&self, mut c: TrainConfig) -> Result<TrainConfig> {
        match self.method.as_deref() {
            Some("ibgs") => c.method = Method::Ibgs,
            Some(_) => c.method = Method::Gs3,
            None => {}
        }
        // The model is opened from other folders too.
        let source = self.scene.as_ref().or(self.source.as_ref()).map(std::path::absolute).transpose()?;
        set_some(&mut c.data.source, &source);
        set(&mut c.data.resolution, &self.resolution);
        set(&mut c.data.resampler, &self.resampler);
        set_some(&mut c.data.images, &self.images);
        set_some(&mut c.data.max_resolution, &self.max_resolution);
        set(&mut c.data.eval_split_every, &self.eval_split_every);
        set(&mut c.data.principal_point, &self.principal_point);
        set(&mut c.data.masks, &self.masks);
        set_some(&mut c.data.alpha, &self.alpha);
        set_some(&mut c.data.color_space, &self.color_space);
        c.data.filter_points |= self.filter_points;
        c.data.eval |= self.eval || self.eval_split_every.is_some();
        set(&mut c.iterations, &self.iterations);
        c.schedule_scaling &= !self.no_schedule_scaling;
        set_some(&mut c.sh_degree, &self.sh_degree);
        set_some(&mut c.init, &self.init.as_ref().map(std::path::absolute).transpose()?);
        if self.init.is_some() && self.iterations.is_none() && self.config.is_none() {
            c.iterations = WARM_ITERATIONS;
        }
        set_some(&mut c.sh_interval, &self.sh_interval);
        set_some(&mut c.learning_rates.mean_iterations, &self.mean_iterations);
        set_some(&mut c.densify.start, &self.densify_start);
        set_some(&mut c.densify.end, &self.densify_end);
        set_some(&mut c.densify.interval, &self.densify_interval);
        set_some(&mut c.opacity_reset.interval, &self.opacity_reset_interval);
        match self.densify.as_deref() {
            Some("absgs") => c.densify.strategy = Strategy::AbsGs,
            Some("mcmc") => c.densify.strategy = Strategy::Mcmc,
            Some("published") => c.densify.strategy = Strategy::Published,
            Some(_) => c.densify.strategy = Strategy::Default,
            None => {}
        }
        set_some(&mut c.densify.max_splats, &self.max_splats);
        set(&mut c.eval_every, &self.eval_every);
        set_some(&mut c.eval_iterations, &self.eval_iterations);
        set_some(&mut c.save_iterations, &self.save_iterations);
        set(&mut c.seed, &self.seed);
        c.white_background |= self.white_background;
        c.deterministic |= self.deterministic;
        self.stages.apply(&mut c);
        Ok(c)
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    if args.with_viewer {
        view::check_display()?;
    }
    let session = args.plan()?.start(|| open_gpu(args.adapter.as_ref()), &|_| {})?;
    if args.with_viewer { view::look(Watched::new(session)) } else { terminal::train(session) }
}
