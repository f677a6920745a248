//! `ibgs merge`

use super::train::{self, Reports, block};
use crate::advice;
use crate::progress::Bars;
use crate::stderr;
use anyhow::{Context, Result, anyhow, bail};
use clap::Args as ClapArgs;
use ibgs_core::blocks::{BlockPlan, Joiner, PlanFolder};
use ibgs_core::config::TrainConfig;
use ibgs_core::counted;
use ibgs_core::files;
use ibgs_core::gpu::GpuError;
use ibgs_core::local_space::LocalSpace;
use ibgs_core::model::load_scene;
use ibgs_core::output::figures::TIME_FILE;
use ibgs_core::output::{Existing, OutputFolder};
use ibgs_core::residual::weights;
use ibgs_core::scene::{PlyFlavor, read_ply, write_ply};
use ibgs_core::sources::memory::MemoryBudget;
use ibgs_train::session::{BuildError, Output, SessionBuilder, StoppedTraining, adjust_cameras};
use ibgs_train::{Session, TrainError};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Example:
  ibgs merge plan -o output/city";

/// Options of `ibgs merge`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Folder of the plan that `ibgs split` made; all of its blocks must be trained.
    plan: PathBuf,
    /// Model folder [default: PLAN/model]. A stopped merge is resumed there.
    #[arg(short, long, value_name = "MODEL")]
    output: Option<PathBuf>,
    /// Iterations in which the joined Gaussians and one residual network are trained on all photos; 0: none, for a model that
    /// is too large for that, with the network of the block with most photos [default: 3000, or those of a block where it
    /// was given fewer].
    #[arg(long)]
    iterations: Option<u32>,
    /// Merge again, in place of the model that the folder holds.
    #[arg(long)]
    overwrite: bool,
    /// Device memory that the training may take: `auto` (what the plan allows), `none`, or a size such as `6GiB`.
    #[arg(long, default_value = "auto")]
    gpu_memory: MemoryBudget,
    /// Adapter by number or part of its name; `ibgs info` lists them [default: the most capable].
    #[arg(long)]
    adapter: Option<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let plan = PlanFolder::at(&args.plan);
    let blocks = plan.read()?;
    let model = args.output.clone().unwrap_or_else(|| plan.model_path());
    refuse_folder(&plan, &model)?;
    let gpu_memory = block::limit(args.gpu_memory, &blocks);
    let is_own = !args.overwrite && belongs_to(&plan, &OutputFolder::at(&model))?;
    if is_own && block::is_trained(&OutputFolder::at(&model))? {
        return say_merged(&model, args.iterations);
    }
    let checkpoints = OutputFolder::at(&model).checkpoints()?;
    if is_own && !checkpoints.is_empty() {
        let resumed = resumed(&plan, &model, args.iterations)?;
        return train::train(resumed.gpu_memory(gpu_memory), args.adapter.as_ref());
    }
    let joined = Joined::write(&plan, &blocks)?;
    let existing = if args.overwrite || is_own { Existing::Replace } else { Existing::Keep };
    let output = Output::at(&model).existing(existing);
    let config = |iterations| joined.config(&plan, iterations, gpu_memory);
    let untrained = || joined.write_model(&config(Some(0))?, &output);
    if args.iterations == Some(0) {
        return untrained();
    }
    let training = Session::builder(config(args.iterations)?).output(output.clone()).gpu_memory(gpu_memory);
    let outcome = train::train(training, args.adapter.as_ref());
    // Unless a training is asked for.
    match outcome.as_ref().err().filter(|_| args.iterations.is_none()).and_then(too_large) {
        Some(why) => {
            stderr!("warning: {why}; so the blocks are merged without a training");
            untrained()
        }
        None => outcome,
    }
}

/// Why the device cannot hold the training of the whole at its beginning; none where something else is wrong.
fn too_large(error: &anyhow::Error) -> Option<String> {
    match error.downcast_ref()? {
        BuildError::DoesNotFit(_) => Some(advice::sentence(error)),
        // The flags that help a training are none of a merge.
        BuildError::Train(TrainError::Gpu(GpuError::OutOfMemory { .. } | GpuError::TooLarge { .. })) => {
            Some(format!("{error:#}"))
        }
        _ => None,
    }
}

/// Refuses the plan's own folder, whose files a model would replace.
pub fn refuse_folder(plan: &PlanFolder, model: &Path) -> Result<()> {
    if files::is_same(plan.root(), model) {
        bail!("{} is the plan itself; choose another `--output`", model.display());
    }
    Ok(())
}

/// Says that a model is there already, if it is the one that is asked for.
fn say_merged(model: &Path, iterations: Option<u32>) -> Result<()> {
    let (folder, path) = (OutputFolder::at(model), model.display());
    let trained = match folder.root().join(TIME_FILE).is_file() {
        true => folder.read_config()?.iterations(),
        false => 0,
    };
    if let Some(wanted) = iterations.filter(|&wanted| wanted != trained) {
        bail!(
            "{path} is a merge with {}, not {wanted}; choose another `--output`, or give `--overwrite`",
            counted(trained, "iteration")
        );
    }
    match trained {
        0 => stderr!("the blocks are merged without a training: {path}; `--overwrite` trains the whole"),
        _ => stderr!("the blocks are merged: {path}"),
    }
    Ok(())
}

/// Whether a folder holds the merged model of a plan.
pub fn is_merged(plan: &PlanFolder, model: &Path) -> Result<bool> {
    let folder = OutputFolder::at(model);
    Ok(belongs_to(plan, &folder)? && block::is_trained(&folder)?)
}

/// Whether a folder is that of a merge of this plan: its training began with the joined Gaussians.
fn belongs_to(plan: &PlanFolder, folder: &OutputFolder) -> Result<bool> {
    if !folder.config_path().is_file() {
        return Ok(false);
    }
    let joined = plan.joined_path();
    // In its usual place it may have moved with the plan.
    let has_moved =
        |start: &Path| start.file_name() == joined.file_name() && files::is_same(folder.root(), &plan.model_path());
    let start = folder.read_config()?.init;
    Ok(start.is_some_and(|start| files::is_same(&start, &joined) || has_moved(&start)))
}

/// The training of a merge that was stopped.
fn resumed(plan: &PlanFolder, model: &Path, iterations: Option<u32>) -> Result<SessionBuilder> {
    let stopped = StoppedTraining::open(model, &mut Reports::to(&|_| {}))?;
    let mut config = stopped.checkpoint().config.clone();
    let own = config.iterations();
    if let Some(iterations) = iterations.filter(|&wanted| wanted != own) {
        let path = model.display();
        bail!(
            "the merge in {path} has {}, not {iterations}; leave `--iterations` out, or give `--overwrite`",
            counted(own, "iteration")
        );
    }
    // The scene may have moved.
    let own = plan.config()?;
    (config.source, config.poses.cameras) = (own.source, own.poses.cameras);
    Ok(Session::builder(config).resumed_from(stopped))
}

/// The blocks, joined.
struct Joined {
    /// Iterations of a block.
    iteration: u32,
    /// The network of the block with most photos: it has seen most of the scene.
    network: Option<PathBuf>,
    /// Extent of the cameras of a block, in scene units.
    extent: Option<f64>,
}

impl Joined {
    /// Joins them, into the plan.
    fn write(plan: &PlanFolder, blocks: &BlockPlan) -> Result<Self> {
        let (mut joiner, mut extents) = (Joiner::default(), Vec::new());
        let (mut network, mut most, mut last) = (None, 0, 0);
        for (number, block) in (0..).zip(&blocks.blocks) {
            let folder = OutputFolder::at(&plan.block_path(number));
            if !block::is_trained(&folder)? {
                let path = plan.root().display();
                bail!(
                    "block {number} is not trained yet; run `ibgs train {path} --block {number}` or `ibgs suite {path}`"
                );
            }
            let iteration = folder.latest_iteration()?.context("it is trained")?;
            last = last.max(iteration);
            if block.train.len() > most {
                (network, most) = (folder.network_path(iteration), block.train.len());
            }
            let cameras = folder.read_cameras()?;
            let space = LocalSpace::of_cameras(cameras.iter().map(|record| &record.camera));
            extents.extend(space.map(|space| space.extent()));
            let trained = read_ply(&folder.point_cloud_path(iteration))?;
            joiner.add(&block.core, trained).map_err(|[own, before]| {
                anyhow!("block {number} has spherical harmonics of degree {own}, the blocks before it {before}; train it anew")
            })?;
        }
        let all = joiner.given();
        let gaussians = joiner.joined();
        stderr!("{} of {all} Gaussians lie in the cores of their blocks", gaussians.len());
        write_ply(&plan.joined_path(), &gaussians, PlyFlavor::Full)?;
        extents.sort_by(f64::total_cmp);
        let extent = extents.get(extents.len() / 2).copied();
        Ok(Self { iteration: last, network, extent })
    }

    /// The options of the model, which begins with the Gaussians in the plan.
    fn config(&self, plan: &PlanFolder, iterations: Option<u32>, limit: MemoryBudget) -> Result<TrainConfig> {
        let path = std::path::absolute(plan.joined_path())?;
        let mut config = plan.config()?;
        config.init = Some(path);
        // What was near for a block must not be too near for the whole.
        config.data.extent = self.extent;
        config.residual.init = self.network.as_ref().map(std::path::absolute).transpose()?;
        // All photos of the scene have a depth map here.
        if let (MemoryBudget::Bytes(bytes), MemoryBudget::Unlimited, false) =
            (limit, config.surface.depth_memory, config.deterministic)
        {
            config.surface.depth_memory = MemoryBudget::Bytes(bytes / 4);
        }
        let given = config.iterations.take().unwrap_or(u32::MAX);
        let usual = config.iterations().min(given);
        config.iterations = Some(iterations.map_or(usual, |wanted| if wanted == 0 { self.iteration } else { wanted }));
        (config.save_iterations, config.eval_iterations) = (Some(Vec::new()), Some(Vec::new()));
        Ok(config)
    }

    /// Writes the model as it is, without a training.
    fn write_model(&self, config: &TrainConfig, output: &Output) -> Result<()> {
        let start = config.init.as_ref().context("a merge begins with the joined Gaussians")?;
        output.check(config.source.as_deref())?;
        let source = config.source.as_ref().context("a plan has a scene")?;
        let mut dataset = load_scene(config, source, &Bars::default())?;
        adjust_cameras(&mut dataset, &mut config.clone(), &Bars::default())?;
        let mut config = config.clone();
        config.adapt_to_object(&dataset);
        let (folder, _lock) = output.create(&config, &dataset)?;
        if let Some(network) = &self.network {
            weights::write(&folder.network_save_path(self.iteration, 1), &weights::load(network)?)?;
        }
        write_ply(&folder.point_cloud_path(self.iteration), &read_ply(start)?, PlyFlavor::Full)?;
        let path = folder.root().display();
        stderr!("written to {path}; `ibgs eval {path}` measures it");
        Ok(())
    }
}
