#!/bin/bash
# The ground truth of one experiment on a cluster with Slurm:
#
#     sbatch examples/slurm_generate.sh examples/jelly3d.toml
#
# How many ranks, how many of them to a solve, and what to expect: docs/large_runs.md.

# One rank is one core: what has to be solved are many independent contacts, and ranks share them out best.
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=32
#SBATCH --cpus-per-task=1
# What a rank needs; the last line that `generate` prints says what it had: "at most ... MiB a rank".
#SBATCH --mem-per-cpu=2G
#SBATCH --job-name=softprint
#SBATCH --output=%x_%j.log
# A requeued job goes on in the same log.
#SBATCH --open-mode=append

# A time limit is no loss: finished contacts lie on disk, and the same command goes on with the rest. Shortly before
# the limit (here 2 minutes) Slurm tells this script, which puts the job back into the queue.
#SBATCH --time=04:00:00
#SBATCH --requeue
#SBATCH --signal=B:USR1@120

set -euo pipefail

experiment=${1:?usage: sbatch $0 EXPERIMENT.toml [options of softprint generate]}
shift

# How many ranks hold a part of the body each and solve a contact together. 1 makes the most contacts an hour; more
# only where a rank's share of memory is too small for the whole body, or one contact takes too long. It has to divide
# the number of ranks. Give one that divides --ntasks-per-node too: then a solve never waits for the network, because
# neighbours in rank are on one node (--distribution=block, below).
ranks_per_solve=${RANKS_PER_SOLVE:-1}

# One thread a rank: more, and they would fight over the cores.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

# Where `softprint` is (make install), and where the run lies: a file system that all nodes see.
softprint=${SOFTPRINT:-.venv/bin/softprint}
out=${OUT:-runs/$(basename "$experiment" .toml)}

# Kernels are compiled on first use and kept in a cache, for the processor at hand. A folder for each run spares other
# jobs from waiting; it has to be one that all nodes see.
export XDG_CACHE_HOME=${XDG_CACHE_HOME:-$PWD/$out/cache}

requeue() {
    echo "the time is nearly over: what is finished is kept, the rest goes back into the queue"
    # SIGTERM ends all ranks; a contact that was being solved is solved again. Wait until they are gone.
    kill -TERM "$running" 2>/dev/null || true
    wait "$running" || true
    scontrol requeue "$SLURM_JOB_ID"
    exit 0
}
trap requeue USR1

# The body once, on one rank (a body that is there already is kept), then the truth on all of them.
"$softprint" body "$experiment" --out "$out" --quiet

# In the background and waited for, or this script would hear the signal only when the run is over. srun needs the
# PMI that Open MPI was built with (`srun --mpi=list`); where there is none, `mpirun` reads the same allocation. A rank
# that is killed, for its memory say, must take the others along: they would wait for it.
srun --mpi=pmix --distribution=block --cpu-bind=cores --kill-on-bad-exit=1 \
    "$softprint" generate "$experiment" --out "$out" --quiet --ranks-per-solve "$ranks_per_solve" "$@" &
running=$!
wait "$running"
