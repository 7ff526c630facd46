#!/bin/bash
# The ground truth of one experiment on a cluster with Slurm:
#
#     sbatch examples/slurm_generate.sh examples/jelly3d.toml
#
# How many ranks, how many of them to a solve, and what to expect: docs/large_runs.md.

# One rank for each core: the contacts are independent, so ranks divide them best.
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=32
#SBATCH --cpus-per-task=1
# Memory of a rank; the last line that `generate` prints tells what it used: "at most ... MiB a rank".
#SBATCH --mem-per-cpu=2G
#SBATCH --job-name=softprint
#SBATCH --output=%x_%j.log
# A requeued job continues the same log.
#SBATCH --open-mode=append

# A time limit loses no work: finished contacts are on disk, and the same command continues with the rest. Shortly
# before the limit (here 2 minutes) Slurm signals this script, which requeues the job.
#SBATCH --time=04:00:00
#SBATCH --requeue
#SBATCH --signal=B:USR1@120

set -euo pipefail

experiment=${1:?usage: sbatch $0 EXPERIMENT.toml [options of softprint generate]}
shift

# Number of ranks that solve one contact together, each with a part of the body. 1 gives the most contacts an hour; use
# more only if a rank's share of memory is too small for the whole body, or one contact takes too long. It must divide
# the number of ranks. Let it divide --ntasks-per-node too: then a solve never waits for the network, because
# neighbours in rank are on one node (--distribution=block, below).
ranks_per_solve=${RANKS_PER_SOLVE:-1}

# One thread for each rank: more would compete for the cores.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

# The path of `softprint` (make install), and the run directory, on a file system that all nodes share.
softprint=${SOFTPRINT:-.venv/bin/softprint}
out=${OUT:-runs/$(basename "$experiment" .toml)}

# Kernels are compiled on first use for the current processor and cached. With a folder for each run, jobs do not wait
# for each other; all nodes must share it.
export XDG_CACHE_HOME=${XDG_CACHE_HOME:-$PWD/$out/cache}

requeue() {
    echo "the time is nearly over: what is finished is kept, the rest goes back into the queue"
    # SIGTERM ends all ranks; an unfinished contact is solved again. Wait until they have ended.
    kill -TERM "$running" 2>/dev/null || true
    wait "$running" || true
    scontrol requeue "$SLURM_JOB_ID"
    exit 0
}
trap requeue USR1

# The body once, on one rank (an existing body is kept), then the truth on all of them.
"$softprint" body "$experiment" --out "$out" --quiet

# In the background with a wait, or this script would receive the signal only after the run. srun needs the
# PMI that Open MPI was built with (`srun --mpi=list`); without one, `mpirun` uses the same allocation. If a rank is
# killed, for instance for its memory, the others must end too: they would wait for it.
srun --mpi=pmix --distribution=block --cpu-bind=cores --kill-on-bad-exit=1 \
    "$softprint" generate "$experiment" --out "$out" --quiet --ranks-per-solve "$ranks_per_solve" "$@" &
running=$!
wait "$running"
