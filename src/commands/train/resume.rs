//! `--resume`: the checkpoint that a training resumes from.

use super::Args;
use crate::stderr;
use anyhow::{Result, bail};
use ibgs_core::output::OutputFolder;
use ibgs_train::checkpoint::{Checkpoint, CheckpointError};
use std::path::Path;
use toml::{Table, Value};

/// The checkpoint to resume from. The scene may have moved, and the host's memory be another; no other option may differ.
pub fn checkpoint(args: &Args, path: &Path) -> Result<Checkpoint> {
    let mut checkpoint = newest(&OutputFolder::at(path))?;
    let mut wanted = args.over(checkpoint.config.clone())?;
    checkpoint.config.data.source.clone_from(&wanted.data.source);
    checkpoint.config.data.host_memory = wanted.data.host_memory;
    // So may a plan of blocks.
    if let Some(plan) = &args.base {
        for config in [&mut checkpoint.config, &mut wanted] {
            config.data.source.clone_from(&plan.data.source);
            config.data.split.clone_from(&plan.data.split);
        }
    }
    let (kept, given) = (Table::try_from(&checkpoint.config)?, Table::try_from(&wanted)?);
    if let Some((name, kept, given)) = difference(&kept, &given) {
        let value = |value: Option<&Value>| value.map_or("unset".to_owned(), Value::to_string);
        bail!(
            "the training in {} has the option `{name}` at {}, not {}; a resumed run keeps its options: leave it out",
            path.display(),
            value(kept),
            value(given)
        );
    }
    Ok(checkpoint)
}

/// The first entry in which two tables differ, by its dotted name.
fn difference<'a>(a: &'a Table, b: &'a Table) -> Option<(String, Option<&'a Value>, Option<&'a Value>)> {
    a.keys().chain(b.keys()).find_map(|key| match (a.get(key), b.get(key)) {
        (Some(Value::Table(a)), Some(Value::Table(b))) => {
            difference(a, b).map(|(name, a, b)| (format!("{key}.{name}"), a, b))
        }
        (a, b) => (a != b).then(|| (key.clone(), a, b)),
    })
}

/// The newest intact checkpoint of a model folder; warns of each damaged one.
///
/// # Errors
/// There is none, or none that is intact.
pub fn newest(folder: &OutputFolder) -> Result<Checkpoint> {
    let found = folder.checkpoints()?;
    let saved = folder.latest_iteration()?.filter(|_| found.is_empty());
    // Killed before its first checkpoint, and after it was saved.
    if let (Some(iteration), Ok(config)) = (saved, folder.read_config())
        && iteration < config.iterations()
    {
        bail!(
            "{} has no checkpoint to resume from, only the model of iteration {iteration} of {}; train on from its Gaussians \
             (`--init {}`), or anew (`--overwrite`)",
            folder.root().display(),
            config.iterations(),
            folder.point_cloud_path(iteration).display()
        );
    }
    if let Some(iteration) = saved {
        bail!(
            "the training in {} has ended, its model has {iteration} iterations; there is nothing to resume",
            folder.root().display()
        );
    }
    if found.is_empty() {
        bail!("{} holds no checkpoint to resume from; train without `--resume`", folder.root().display());
    }
    let count = found.len();
    for (number, (_, path)) in found.iter().enumerate() {
        match Checkpoint::read(path) {
            Err(error @ CheckpointError::Damaged { .. }) if number + 1 < count => {
                stderr!("warning: {error}; resuming from the one before");
            }
            outcome => return Ok(outcome?),
        }
    }
    unreachable!("the last one returns")
}
