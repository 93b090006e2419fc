#!/bin/sh
# Renders a path of a scene as a Slurm job array, one shard per task; then the video. Run it in the folder of the scene:
#
#   job=$(sbatch --parsable deploy/slurm_array.sh scene frames --path spiral:900)
#   sbatch --dependency=afterok:$job --wrap="liveview join frames -o flight.mp4"
#
# To run a failed task again: `sbatch --array=7 deploy/slurm_array.sh …`. LIVEVIEW_SHARDS tells it the number of shards, and it
# keeps what it has rendered.
#SBATCH --job-name=liveview
#SBATCH --array=0-15
#SBATCH --cpus-per-task=4
#SBATCH --mem=4G
#SBATCH --time=01:00:00
#SBATCH --requeue
set -eu

scene=$1
frames=$2
shift 2

# The number of tasks in --array, which start at 0.
export LIVEVIEW_SHARDS="${LIVEVIEW_SHARDS:-16}"

exec "${LIVEVIEW:-liveview}" render "$scene" "$@" -o "$frames" --shard auto --resume \
	--threads "${SLURM_CPUS_PER_TASK:-1}"
