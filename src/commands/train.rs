//! `ibgs train`

mod estimate;
mod keeper;
mod resume;
mod run;
mod stages;
mod watch;

pub use run::Run;

use super::{load_demo, load_scene, open_gpu, view};
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::dataset::demo::DemoOptions;
use ibgs_core::dataset::{Alpha, ColorSpace, Dataset, Masks};
use ibgs_core::fuse::memory::MemoryBudget;
use ibgs_core::gpu::Gpu;
use ibgs_core::raster::Rasterizer;
use ibgs_core::scene::read_ply;
use ibgs_core::tell;
use ibgs_core::train::Trainer;
use ibgs_core::train::config::{DataConfig, Method, Strategy, TrainConfig};
use ibgs_core::train::output::{Existing, OutputFolder};
use stages::StageArgs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Iterations and most Gaussians of the demo scene when none are asked for: on a software adapter and on a GPU.
const DEMO_ITERATIONS: [u32; 2] = [200, 10_000];
/// Size of the residual network's images in the demo scene, relative to the photos.
const DEMO_RESIDUAL_FACTOR: [f64; 2] = [0.5, 1.0];
/// Iterations of a run that begins with a finished model, when none are asked for.
const WARM_ITERATIONS: u32 = 3_000;
const DEMO_SPLATS: [u32; 2] = [12_000, 1_000_000];

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
    let run = start(args, || open_gpu(args.adapter.as_ref()), &|_| {})?;
    if args.with_viewer { view::look(run) } else { run.train() }
}

/// Prepares a training: `told` hears what is being done. The GPU is asked for after the files have been read.
pub fn start(args: &Args, gpu: impl FnOnce() -> Result<Arc<Gpu>>, told: &dyn Fn(&str)) -> Result<Run> {
    // Mistakes that need no GPU first, and nothing is written before all that can be checked has been.
    let resumed =
        args.model.as_deref().filter(|_| args.resume).map(|path| resume::checkpoint(args, path)).transpose()?;
    let mut config = match &resumed {
        Some(checkpoint) => checkpoint.config.clone(),
        None => args.config()?,
    };
    config.validate()?;
    if resumed.is_none() {
        refuse_output(args)?;
    }
    let start = config.init.as_deref().filter(|_| resumed.is_none()).map(read_ply).transpose()?;
    told("loading the photos");
    let scene = config.data.source.clone().map(|source| load_scene(&config, &source)).transpose()?;
    if scene.is_none() {
        refuse_scene_options(&config.data)?;
    }
    let gpu = gpu()?;
    let dataset = match scene {
        Some(dataset) => dataset,
        None => {
            told("ray tracing the demo scene; this takes some minutes the first time");
            if resumed.is_none() {
                demo_options(&mut config, args, &gpu);
            }
            demo_scene(&config, &gpu)?
        }
    };
    config.densify.choose_cap(dataset.train.iter().map(|&i| dataset.views[i].camera.pixels() as u64).sum());
    told("preparing the training");
    let started = Instant::now();
    let raster = Arc::new(Rasterizer::new(gpu.clone()));
    gpu.warm_up();
    let mut trainer = match (&resumed, start) {
        (Some(checkpoint), _) => Trainer::resume(raster.clone(), &dataset, checkpoint)?,
        (None, Some(start)) => {
            config.sh_degree = Some(start.sh_degree);
            Trainer::from_gaussians(raster.clone(), &dataset, &config, &start)?
        }
        (None, None) => Trainer::new(raster.clone(), &dataset, &config)?,
    };
    let mut needs = estimate::Needs::of(&trainer, &raster, &dataset, &config);
    if let Some(most) = needs.limit(args.gpu_memory, &gpu)? {
        config.densify.max_splats = Some(most);
        trainer.limit_splats(most);
    }
    let needs = needs.sentence();
    let folder = match (&resumed, &args.model) {
        (Some(checkpoint), Some(path)) => {
            tell!("going on from iteration {} of {}", checkpoint.iteration(), config.iterations);
            let folder = OutputFolder::at(path);
            // The scene may have moved.
            config.save(&folder.config_path())?;
            folder
        }
        _ => create_output(args, &config, &dataset)?,
    };
    tell!(
        "{} training views, {} test views, {} initial points; writing to {}",
        dataset.train.len(),
        dataset.test.len(),
        dataset.points.len(),
        folder.root().display()
    );
    tell!("{needs}");
    let every = (args.checkpoint_every > 0.0).then(|| Duration::from_secs_f64(60.0 * args.checkpoint_every));
    let run = Run::new(trainer, raster, dataset, config, folder, every, started);
    Ok(match &resumed {
        Some(checkpoint) => run.with_records_of(checkpoint),
        None => run,
    })
}

/// Options of photos on disk would be ignored, and still stand in the results.
fn refuse_scene_options(data: &DataConfig) -> Result<()> {
    let usual = DataConfig::default();
    let given = [
        ("--resolution", data.resolution != usual.resolution),
        ("--resampler", data.resampler != usual.resampler),
        ("--images", data.images != usual.images),
        ("--max-resolution", data.max_resolution != usual.max_resolution),
        ("--eval-split-every", data.eval_split_every != usual.eval_split_every),
        ("--masks", data.masks != usual.masks),
        ("--alpha", data.alpha != usual.alpha),
        ("--color-space", data.color_space != usual.color_space),
        ("--filter-points", data.filter_points != usual.filter_points),
        ("--principal-point", data.principal_point != usual.principal_point),
    ];
    match given.iter().find(|(_, given)| *given) {
        Some((option, _)) => bail!("option `{option}` does not apply to the built-in demo scene; leave it out"),
        None => Ok(()),
    }
}

/// Options of the demo scene where none are given.
fn demo_options(config: &mut TrainConfig, args: &Args, gpu: &Gpu) {
    let size = usize::from(!gpu.is_software());
    // An options file counts in full: one that an earlier run wrote must give that run again.
    if args.config.is_none() {
        let usual = DEMO_ITERATIONS[size];
        let usual = if args.init.is_some() { usual.min(WARM_ITERATIONS) } else { usual };
        config.iterations = args.iterations.unwrap_or(usual);
        config.densify.max_splats = args.max_splats.or(Some(DEMO_SPLATS[size]));
        config.residual.factor = args.stages.residual_factor.unwrap_or(DEMO_RESIDUAL_FACTOR[size]);
    }
    config.data.eval = true;
}

fn demo_scene(config: &TrainConfig, gpu: &Gpu) -> Result<Dataset> {
    let options = if gpu.is_software() { DemoOptions::small() } else { DemoOptions::large() };
    let dataset = load_demo(&options, config.data.demo_exposure_seed)?;
    for note in &dataset.notes {
        tell!("note: {note}");
    }
    Ok(dataset)
}

/// Refuses a folder that is there and may not be trained into, without touching it.
fn refuse_output(args: &Args) -> Result<()> {
    if let Some(path) = args.model.as_ref().filter(|path| path.exists() && !(args.overwrite && path.is_dir())) {
        OutputFolder::create(path, Existing::Keep)?;
    }
    Ok(())
}

/// Makes the output folder and writes what is known before training; a new folder goes again where that fails.
fn create_output(args: &Args, config: &TrainConfig, dataset: &Dataset) -> Result<OutputFolder> {
    let path = match &args.model {
        Some(path) => path.clone(),
        None => free_folder(args, config.data.source.as_deref())?,
    };
    let (existing, is_new) = (if args.overwrite { Existing::Replace } else { Existing::Keep }, !path.exists());
    let folder = OutputFolder::create(&path, existing)?;
    if let Err(error) = folder.write_start(config, dataset) {
        if is_new {
            let _ = std::fs::remove_dir_all(&path);
        }
        return Err(error.into());
    }
    Ok(folder)
}

fn free_folder(args: &Args, source: Option<&Path>) -> Result<PathBuf> {
    let name = match source {
        Some(path) => path.file_stem().and_then(|n| n.to_str()).unwrap_or("scene").to_owned(),
        None => "demo".to_owned(),
    };
    let mut candidates = std::iter::once(name.clone()).chain((2..).map(|i| format!("{name}-{i}")));
    let free = candidates.find_map(|n| Some(Path::new("output").join(n)).filter(|p| !p.exists() || args.overwrite));
    free.context("no free output folder")
}
