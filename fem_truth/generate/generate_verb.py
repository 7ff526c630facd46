"""`softprint generate`: ground truth of contact, on one rank or under mpirun, resumable, one file at the
end."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from typing import TYPE_CHECKING

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.progress import tell_failure
from softprint.runtime.cli.ranks import end_with_launcher, is_launched
from softprint.runtime.cli.verb import Verb

# More failed contacts than this share, of as many as this, make the exit status 1: what was asked for is not there.
FAILED_SHARE, FEWEST = 0.2, 10

if TYPE_CHECKING:
    from softprint.fem_truth.generate.pipeline import Run
    from softprint.runtime.arrays import Array, BoolArray


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options that limit one run."""
    parser.add_argument(
        "--units",
        type=int,
        metavar="K",
        help="stop after K more contacts; the truth file then contains a usable part",
    )
    parser.add_argument(
        "--time-budget", type=float, metavar="MINUTES", help="start no new contact after this many minutes"
    )
    parser.add_argument(
        "--ranks-per-solve",
        type=int,
        default=1,
        metavar="K",
        help="partition the body over K ranks, which solve each contact together, for bodies that are too large for "
        "one rank; K has to divide the number of ranks",
    )


def run(args: argparse.Namespace, context: Context) -> int:
    """Compute the truth of the whole plan, or as much of it as the options allow; writes truth.h5 and .xdmf in the run
    directory."""
    if is_launched():
        end_with_launcher()
    # Import h5py before DOLFINx: PyPI's wheel of h5py crashes if it is imported after it.
    import h5py  # noqa: F401
    from mpi4py import MPI

    from softprint.fem_truth.generate.farm import first_rank_first
    from softprint.fem_truth.generate.pipeline import Options, generate
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.errors import SoftprintError

    for name, value in (("--units", args.units), ("--time-budget", args.time_budget)):
        if value is not None and not value >= 0:  # nan is not, either
            raise SoftprintError(f"{name} {value}: must be a number that is not negative")
    _warn_of_threads(context, MPI.COMM_WORLD.size)
    options = Options(
        units=args.units,
        minutes=args.time_budget,
        resume=context.resume,
        ranks_per_solve=args.ranks_per_solve,
        progress=context.progress,
        stage=context.stage,
    )
    body = first_rank_first(MPI.COMM_WORLD, lambda: body_of_run(context))
    done = generate(MPI.COMM_WORLD, context.experiment, body, context.out_dir, options)
    if MPI.COMM_WORLD.rank > 0:
        return 0
    context.say(_summary(done, MPI.COMM_WORLD.size, args.ranks_per_solve))
    complaint = _failed_contacts(done)
    if complaint:
        tell_failure(complaint)
        print(complaint, file=sys.stderr)
    return 1 if complaint else 0


def _warn_of_threads(context: Context, ranks: int) -> None:
    import os

    if ranks > 1 and os.environ.get("OMP_NUM_THREADS") != "1":
        context.say(
            "OMP_NUM_THREADS is not 1, so the threads of all ranks compete for the cores: OMP_NUM_THREADS=1 mpirun ..."
        )


def _summary(done: Run, ranks: int, ranks_per_solve: int) -> str:
    """Content and cost of the truth file, in a few lines."""
    import numpy as np

    from softprint.runtime.truth.truth_file import load_truth
    from softprint.runtime.truth.truth_schema import CONVERGED

    with load_truth(done.truth) as truth:
        if not truth.header.colliders:
            return (
                f"{done.truth}: {len(truth.states)} states without contact ({len(truth.refused)} refused)\n"
                f"  {truth.states['seconds'].sum() / max(1, len(truth.states)):.3f} core-seconds a state\n"
                f"  this run: {done.seconds:.1f} s on {ranks} rank(s), at most "
                f"{done.peak_memory / 2**20:.0f} MiB a rank"
            )
        samples, n_contacts = truth.samples, len(truth.contacts)
        n = max(1, truth.n_samples)
        converged = np.count_nonzero(samples["status"] == CONVERGED)
        lines = [
            f"{done.truth}: {n_contacts} of {truth.header.planned_contacts} contacts"
            + ("" if truth.complete else " (partial: the same command continues)"),
            f"  {truth.n_samples} samples at {len(truth.states)} states ({len(truth.refused)} refused), "
            f"{100 * converged / n:.1f} % converged, "
            f"{np.count_nonzero(samples['branch_flag'])} flagged as jumps, {np.count_nonzero(truth.pierced)} pierced, "
            f"{np.count_nonzero(truth.inverted)} with inverted cells, {np.count_nonzero(truth.usable)} usable",
            "  no contact was solved twice, so that label noise is not known"
            if not len(truth.repeat)
            else f"  label noise {100 * truth.noise_floor:.2g} % ({len(truth.repeat)} solved twice)",
            f"  {_depths(samples['max_depth'], samples['intrusion'], samples['status'] == CONVERGED)}",
            f"  {truth.contacts['seconds'].sum() / n:.3f} core-seconds of solves a sample (second paths included)",
        ]
    together = f"{ranks_per_solve} to a solve, " if ranks_per_solve > 1 else ""
    lines.append(
        f"  this run: {done.solved} contacts in {done.seconds:.1f} s on {ranks} rank(s), {together}"
        f"at most {done.peak_memory / 2**20:.0f} MiB a rank"
    )
    return "\n".join(lines)


def _failed_contacts(done: Run) -> str:
    """A sentence with the most frequent reason if more than a fifth of the contacts have no converged sample."""
    import numpy as np

    from softprint.runtime.truth.truth_file import load_truth
    from softprint.runtime.truth.truth_schema import CONVERGED

    with load_truth(done.truth) as truth:
        samples, n = truth.samples, len(truth.contacts)
        solved = np.unique(samples["contact"][samples["status"] == CONVERGED])
        if n < FEWEST or n - len(solved) <= FAILED_SHARE * n:
            return ""
        failed = ~np.isin(samples["contact"], solved) & (samples["depth_index"] == 0)
        reasons = Counter(str(reason) for reason in samples["reason"][failed])
    reason, times = reasons.most_common(1)[0]
    return (
        f"{done.truth}: {n - len(solved)} of {n} contacts have no converged sample, which is more than a fifth; "
        f"the most frequent reason, of {times}: {reason}"
    )


def _depths(penetration: Array, intrusion: Array, good: BoolArray) -> str:
    """How deep colliders are inside the body: what the contact law sees, and what there is."""
    import numpy as np

    if not good.any():
        return "no sample has converged"
    seen, there = 1e3 * penetration[good], 1e3 * intrusion[good]
    return (
        f"penetration {np.median(seen):.2g} mm (at most {seen.max():.2g}); colliders are {np.median(there):.2g} mm "
        f"inside the body (at most {there.max():.2g})"
    )


VERB = Verb(
    name="generate",
    order=20,
    summary="Solve the ground truth of contact with finite elements, also under mpirun.",
    example="OMP_NUM_THREADS=1 mpirun -n 2 softprint generate examples/jelly3d_small.toml",
    run=run,
    needs=("dolfinx", "mpi4py", "h5py"),
    configure=configure,
)
