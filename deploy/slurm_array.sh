#!/bin/sh
# A path of a scene, shared out over a Slurm job array; then the video. From the folder that holds the scene:
#
#   job=$(sbatch --parsable deploy/slurm_array.sh scene frames --path spiral:900)
#   sbatch --dependency=afterok:$job --wrap="liveview join frames -o flight.mp4"
#
# A task that failed is submitted again alone, `sbatch --array=7 deploy/slurm_array.sh …`: it knows its share by LIVEVIEW_SHARDS,
# and keeps what it has rendered.
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

# As many as --array names, from 0 on.
export LIVEVIEW_SHARDS="${LIVEVIEW_SHARDS:-16}"

exec "${LIVEVIEW:-liveview}" render "$scene" "$@" -o "$frames" --shard auto --resume \
	--threads "${SLURM_CPUS_PER_TASK:-1}"
