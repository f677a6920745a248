//! `ibgs train PLAN --block N`

use super::json_log::Before;
use super::{Args, run_whole};
use crate::stderr;
use anyhow::{Context, Result};
use ibgs_core::blocks::{BlockPlan, PlanFolder};
use ibgs_core::output::OutputFolder;
use ibgs_core::sources::memory::MemoryBudget;
use std::path::Path;

/// Trains a block of a plan, or resumes its training.
pub fn train(args: &Args, number: u32) -> Result<()> {
    let plan = PlanFolder::at(args.scene.as_deref().unwrap_or(Path::new(".")));
    let blocks = plan.read()?;
    let base = plan.block_config(&blocks, number)?;
    let (path, folder) = (plan.block_path(number), OutputFolder::at(&plan.block_path(number)));
    let is_stopped = !folder.checkpoints()?.is_empty();
    if !args.overwrite && is_trained(&folder)? {
        stderr!("block {number} is trained: {}", path.display());
        return Ok(());
    }
    let resume = is_stopped && !args.overwrite;
    let before = Before::of(resume, args.overwrite);
    let block = Args {
        scene: None,
        block: None,
        base: Some(base),
        model: Some(path),
        resume,
        // Without a checkpoint, what a killed training left is of no use.
        overwrite: !resume,
        gpu_memory: limit(args.gpu_memory, &blocks),
        ..args.clone()
    };
    run_whole(&block, before).with_context(|| format!("block {number} of {}", plan.root().display()))
}

/// The memory that a training may take: what is given, else what the plan allows.
pub fn limit(given: MemoryBudget, plan: &BlockPlan) -> MemoryBudget {
    match (given, plan.memory_limit) {
        (MemoryBudget::Auto, Some(bytes)) => MemoryBudget::Bytes(bytes),
        _ => given,
    }
}

/// Whether a training has come to its end.
///
/// # Errors
/// Its options cannot be read.
pub fn is_trained(folder: &OutputFolder) -> Result<bool> {
    Ok(match folder.latest_iteration()? {
        Some(iteration) if folder.checkpoints()?.is_empty() => iteration >= folder.read_config()?.iterations(),
        _ => false,
    })
}
