//! `ibgs merge`

use super::train::{self, Plan, block};
use crate::stderr;
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::blocks::{BlockPlan, PlanFolder, join};
use ibgs_core::config::TrainConfig;
use ibgs_core::local_space::LocalSpace;
use ibgs_core::output::OutputFolder;
use ibgs_core::scene::{PlyFlavor, read_ply, write_ply};
use ibgs_core::sources::memory::MemoryBudget;
use std::path::PathBuf;

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
    /// Iterations in which the joined Gaussians and one residual network are trained on all photos [default: 3000, or those
    /// of a block where it was given fewer].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
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
        _ => Plan { overwrite: args.overwrite, ..Plan::new(joined(&plan, &blocks, args.iterations)?) },
    };
    merge.model = Some(model);
    merge.gpu_memory = block::limit(args.gpu_memory, &blocks);
    train::train(merge, args.adapter.as_ref())
}

/// Joins the blocks, and returns the options of the training that follows.
fn joined(plan: &PlanFolder, blocks: &BlockPlan, iterations: Option<u32>) -> Result<TrainConfig> {
    let (mut parts, mut extents) = (Vec::with_capacity(blocks.blocks.len()), Vec::new());
    for (number, block) in (0..).zip(&blocks.blocks) {
        let folder = OutputFolder::at(&plan.block_path(number));
        if !block::is_trained(&folder)? {
            let path = plan.root().display();
            bail!("block {number} is not trained yet; run `ibgs train {path} --block {number}` or `ibgs suite {path}`");
        }
        let iteration = folder.latest_iteration()?.context("it is trained")?;
        let cameras = folder.read_cameras()?;
        extents.extend(LocalSpace::of_cameras(cameras.iter().map(|record| &record.camera)).map(|space| space.extent()));
        parts.push((block.core, read_ply(&folder.point_cloud_path(iteration))?));
    }
    // The network of the block with most photos has seen most of the scene.
    let largest = (0..).zip(&blocks.blocks).max_by_key(|(_, block)| block.train.len()).map(|(number, _)| number);
    let folder = OutputFolder::at(&plan.block_path(largest.context("a plan has blocks")?));
    let network = folder.latest_iteration()?.and_then(|iteration| folder.network_path(iteration));
    let degree = parts[0].1.sh_degree;
    if let Some(other) = parts.iter().position(|(_, part)| part.sh_degree != degree) {
        bail!("block {other} has spherical harmonics of another degree than block 0; train both with the same options");
    }
    let all: usize = parts.iter().map(|(_, part)| part.len()).sum();
    let joined = join(parts);
    stderr!("{} of {all} Gaussians lie in the cores of their blocks", joined.len());
    let path = std::path::absolute(plan.joined_path())?;
    write_ply(&path, &joined, PlyFlavor::Full)?;
    let mut config = plan.config()?;
    config.init = Some(path);
    // What was near for a block must not be too near for the whole.
    extents.sort_by(f64::total_cmp);
    config.data.extent = extents.get(extents.len() / 2).copied();
    config.residual.init = network.map(std::path::absolute).transpose()?;
    let given = config.iterations.take();
    config.iterations = Some(iterations.unwrap_or_else(|| given.unwrap_or(u32::MAX).min(config.iterations())));
    (config.save_iterations, config.eval_iterations) = (Some(Vec::new()), Some(Vec::new()));
    Ok(config)
}
