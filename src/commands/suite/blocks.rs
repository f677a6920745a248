//! `ibgs suite PLAN`: the blocks of a scene, their merging and its measurement.

use super::processes::Processes;
use super::{Args, Task, stopped_by_signals, work};
use crate::commands::merge::{is_merged, refuse_folder};
use crate::commands::train::block::is_trained;
use crate::{stderr, stdout};
use anyhow::{Context, Result, bail};
use ibgs_core::blocks::PlanFolder;
use ibgs_core::output::OutputFolder;
use ibgs_core::output::figures::SPEED_FILE;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};

/// A process of a plan.
enum Step {
    Block(u32),
    Merge,
    Eval,
}

struct PlanTask<'a> {
    step: Step,
    plan: &'a PlanFolder,
    model: &'a Path,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let plan = PlanFolder::at(&args.config);
    let read = plan.read()?;
    let blocks = read.blocks.len();
    refuse(args)?;
    let model = args.output.clone().unwrap_or_else(|| plan.model_path());
    refuse_folder(&plan, &model)?;
    let task = |step| PlanTask { step, plan: &plan, model: &model };
    let processes = stopped_by_signals();
    let trainings: Vec<PlanTask> = (0..).take(blocks).map(|number| task(Step::Block(number))).collect();
    let failed = work(&trainings, args, &processes)?;
    if let Some(first) = failed.first() {
        bail!("{} of {blocks} blocks failed; the first one's log is {}", failed.len(), first.display());
    }
    if args.shard.is_some() {
        stderr!(
            "the blocks of this part are trained; once the others are too, the same command without `--shard` merges"
        );
        return Ok(());
    }
    let one = |step| {
        let tasks = [task(step)];
        match work(&tasks, &first_adapter(args), &processes)?.first() {
            None => Ok(()),
            Some(log) => bail!("{} failed; its log is {}", tasks[0].title(), log.display()),
        }
    };
    one(Step::Merge)?;
    if read.holds_out() {
        one(Step::Eval)?;
    }
    stdout!("{}", model.display());
    Ok(())
}

/// Refuses options that a plan has no use for.
fn refuse(args: &Args) -> Result<()> {
    let given = [
        ("--scenes", !args.scenes.is_empty()),
        ("--runs", !args.runs.is_empty()),
        ("--iterations", args.iterations.is_some()),
        ("--lpips-weights", !args.lpips_weights.is_empty()),
        ("--summary-only", args.summary_only),
        ("--data", args.data != Path::new(".")),
    ];
    match given.iter().find(|(_, given)| *given) {
        Some((option, _)) => bail!("`{option}` does not apply to a plan of blocks; leave it out"),
        None => Ok(()),
    }
}

fn first_adapter(args: &Args) -> Args {
    Args { adapters: args.adapters.iter().take(1).cloned().collect(), ..args.clone() }
}

impl Task for PlanTask<'_> {
    fn title(&self) -> String {
        match self.step {
            Step::Block(number) => format!("block {number}: training"),
            Step::Merge => "merging".to_owned(),
            Step::Eval => "measuring".to_owned(),
        }
    }

    fn log(&self) -> PathBuf {
        match self.step {
            Step::Block(number) => self.plan.block_path(number).with_extension("log"),
            Step::Merge => self.plan.root().join("merge.log"),
            Step::Eval => self.plan.root().join("eval.log"),
        }
    }

    fn is_done(&self) -> bool {
        match self.step {
            Step::Block(number) => is_trained(&OutputFolder::at(&self.plan.block_path(number))).unwrap_or(false),
            Step::Merge => is_merged(self.plan, self.model).unwrap_or(false),
            Step::Eval => self.model.join(SPEED_FILE).is_file(),
        }
    }

    fn run(&self, program: &Path, adapter: Option<&String>, processes: &Processes) -> Result<Option<ExitStatus>> {
        let log = File::create(self.log()).with_context(|| format!("cannot write {}", self.log().display()))?;
        let mut command = Command::new(program);
        match self.step {
            Step::Block(number) => {
                _ = command.arg("train").arg(self.plan.root()).args(["--block", &number.to_string()]);
            }
            Step::Merge => _ = command.arg("merge").arg(self.plan.root()).arg("-o").arg(self.model),
            Step::Eval => _ = command.arg("eval").arg(self.model),
        }
        command.args(adapter.iter().flat_map(|name| ["--adapter", name.as_str()]));
        command.stdin(Stdio::null()).stdout(log.try_clone()?).stderr(log);
        Ok(processes.run(&mut command)?)
    }
}
