//! `ibgs merge`

use super::train::{self, Plan, block};
use crate::progress::Bars;
use crate::stderr;
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::blocks::{BlockPlan, PlanFolder, join};
use ibgs_core::config::TrainConfig;
use ibgs_core::files;
use ibgs_core::local_space::LocalSpace;
use ibgs_core::model::load_scene;
use ibgs_core::output::{Existing, OutputFolder};
use ibgs_core::residual::weights;
use ibgs_core::scene::{Gaussians, PlyFlavor, read_ply, write_ply};
use ibgs_core::sources::memory::MemoryBudget;
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
    let folder = OutputFolder::at(&model);
    let mut merge = match &folder.checkpoints()?[..] {
        [_, ..] if !args.overwrite => {
            let resumed = train::newest(&folder)?;
            Plan { resumed: Some(resumed.clone()), ..Plan::new(resumed.config.clone()) }
        }
        _ if block::is_trained(&folder)? && !args.overwrite => {
            stderr!("the blocks are merged: {}", model.display());
            return Ok(());
        }
        _ => {
            let joined = Joined::read(&plan, &blocks)?;
            if args.iterations == Some(0) {
                return joined.write(&plan, &model, args.overwrite);
            }
            Plan { overwrite: args.overwrite, ..Plan::new(joined.config(&plan, args.iterations, blocks.memory_limit)?) }
        }
    };
    merge.model = Some(model);
    merge.gpu_memory = block::limit(args.gpu_memory, &blocks);
    train::train(merge, args.adapter.as_ref())
}

/// The blocks, joined.
struct Joined {
    gaussians: Gaussians,
    /// Iterations of a block.
    iteration: u32,
    /// The network of the block with most photos: it has seen most of the scene.
    network: Option<PathBuf>,
    /// Extent of the cameras of a block, in scene units.
    extent: Option<f64>,
}

impl Joined {
    fn read(plan: &PlanFolder, blocks: &BlockPlan) -> Result<Self> {
        let (mut parts, mut extents) = (Vec::with_capacity(blocks.blocks.len()), Vec::new());
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
            parts.push((block.core, read_ply(&folder.point_cloud_path(iteration))?));
        }
        let degree = parts[0].1.sh_degree;
        if let Some(other) = parts.iter().position(|(_, part)| part.sh_degree != degree) {
            bail!(
                "block {other} has spherical harmonics of another degree than block 0; train both with the same options"
            );
        }
        let all: usize = parts.iter().map(|(_, part)| part.len()).sum();
        let gaussians = join(parts);
        stderr!("{} of {all} Gaussians lie in the cores of their blocks", gaussians.len());
        extents.sort_by(f64::total_cmp);
        let extent = extents.get(extents.len() / 2).copied();
        Ok(Self { gaussians, iteration: last, network, extent })
    }

    /// The options of the training that follows.
    fn config(&self, plan: &PlanFolder, iterations: Option<u32>, limit: Option<u64>) -> Result<TrainConfig> {
        let path = std::path::absolute(plan.joined_path())?;
        write_ply(&path, &self.gaussians, PlyFlavor::Full)?;
        let mut config = plan.config()?;
        config.init = Some(path);
        // What was near for a block must not be too near for the whole.
        config.data.extent = self.extent;
        config.residual.init = self.network.as_ref().map(std::path::absolute).transpose()?;
        // All photos of the scene have a depth map here.
        if let Some(bytes) = limit {
            config.surface.depth_memory = MemoryBudget::Bytes(bytes / 4);
        }
        let given = config.iterations.take();
        config.iterations = Some(iterations.unwrap_or_else(|| given.unwrap_or(u32::MAX).min(config.iterations())));
        (config.save_iterations, config.eval_iterations) = (Some(Vec::new()), Some(Vec::new()));
        Ok(config)
    }

    /// Writes the model as it is, without a training.
    fn write(&self, plan: &PlanFolder, model: &Path, overwrite: bool) -> Result<()> {
        let mut config = plan.config()?;
        config.data.extent = self.extent;
        config.iterations = Some(self.iteration);
        let source = config.data.source.clone().context("a plan has a scene")?;
        let dataset = load_scene(&config, &source, &Bars::default())?;
        files::create_folder(model)?;
        // Before anything in it is removed.
        let _lock = OutputFolder::at(model).lock()?;
        let folder = OutputFolder::create(model, if overwrite { Existing::Replace } else { Existing::Keep })?;
        folder.write_start(&config, &dataset)?;
        if let Some(network) = &self.network {
            weights::write(&folder.network_save_path(self.iteration), &weights::load(network)?)?;
        }
        write_ply(&folder.point_cloud_path(self.iteration), &self.gaussians, PlyFlavor::Full)?;
        stderr!("written to {}; `ibgs eval {}` measures it", model.display(), model.display());
        Ok(())
    }
}
