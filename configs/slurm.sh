#!/usr/bin/env bash
# A suite as a Slurm job array: each task takes its part of the runs. Afterwards, on any machine:
#   ibgs suite configs/benchmarks/mip-nerf-360.toml --data "$DATA" -o "$OUT" --summary-only
#SBATCH --job-name=ibgs
#SBATCH --array=1-9
#SBATCH --gres=gpu:1
#SBATCH --cpus-per-task=8
#SBATCH --time=04:00:00
set -euo pipefail
ibgs suite "${1:-configs/benchmarks/mip-nerf-360.toml}" --data "${DATA:?folder of the scenes}" -o "${OUT:?output folder}" \
    --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT"
