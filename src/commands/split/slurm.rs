//! The script that hands a plan to Slurm.

use anyhow::Result;
use ibgs_core::blocks::{BlockPlan, PlanFolder};
use ibgs_core::files;

/// Writes `slurm.sh`: it submits an array of the blocks, and the steps after it that wait for it.
pub fn write(folder: &PlanFolder, plan: &BlockPlan) -> Result<()> {
    let last = plan.blocks.len() - 1;
    let evaluation = match plan.holds_out() {
        true => {
            "submit evaluate --dependency=\"afterok:$merged\" --kill-on-invalid-dep=yes \\\n  \
                 --wrap=\"exec '$ibgs' eval '$plan/model'\" \"$@\"\n"
        }
        false => "",
    };
    let text = format!(
        r#"#!/bin/sh
# Trains the blocks of this plan as a Slurm array, and merges them when all are trained. Arguments go to every `sbatch`, for
# instance: sh slurm.sh --partition=gpu --time=4:00:00
# IBGS names the program, if it is not `ibgs`. A job that reaches its time limit or is preempted saves first. Slurm requeues
# the latter; after the former run this script again: blocks that are trained end at once. Logs: slurm-*.log beside it.
set -eu
plan=$(cd "$(dirname "$0")" && pwd)
ibgs=${{IBGS:-ibgs}}

# submit NAME OPTION...: prints the number of the job.
submit() {{
  name=$1
  shift
  sbatch --parsable --job-name="ibgs-$name" --gres=gpu:1 --requeue --signal=B:TERM@120 \
    --output="$plan/slurm-$name-%j.log" "$@"
}}

blocks=$(submit train --array=0-{last} \
  --wrap="exec '$ibgs' train '$plan' --block \$SLURM_ARRAY_TASK_ID" "$@")
# Without the name of a cluster.
blocks=${{blocks%%;*}}
merged=$(submit merge --dependency="afterok:$blocks" --kill-on-invalid-dep=yes \
  --wrap="exec '$ibgs' merge '$plan'" "$@")
merged=${{merged%%;*}}
{evaluation}"#
    );
    files::write_atomically(&folder.root().join("slurm.sh"), |out| out.write_all(text.as_bytes()))?;
    Ok(())
}
