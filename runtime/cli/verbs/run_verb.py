"""`softprint run`: all steps from an experiment file to its report, with one progress bar."""

from __future__ import annotations

import argparse

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """How many ranks the reference solutions are solved on, and whether the report has renderings."""
    parser.add_argument(
        "--ranks",
        type=int,
        metavar="N",
        help="MPI ranks of `generate` (default: one for each core, where there is mpirun)",
    )
    parser.add_argument(
        "--no-pictures",
        action="store_true",
        help="leave renderings out of the report (see `softprint report`)",
    )


def run(args: argparse.Namespace, context: Context) -> int:
    """Body, generate, train, simulate and report, each in its own process; finished work is kept. Prints what
    matters."""
    from softprint.runtime.cli.run_steps import errors_left, run_steps, steps_of, usable_ranks
    from softprint.runtime.errors import SoftprintError

    experiment = context.experiment
    training = experiment.training
    if not (training.models or training.internal) or not experiment.scenes_of_role("test"):
        raise SoftprintError(
            f"{experiment.path}: `softprint run` needs [[training.models]] or [[training.internal]] to train and "
            'a scene of role "test" to judge them '
            "in; call the steps one by one instead"
        )
    run_steps(context, steps_of(context, usable_ranks(args.ranks), not args.no_pictures))
    for line in errors_left(context.out_dir):
        context.say(line)
    context.say(f"report: {context.out_dir / 'report.html'}")
    return 0


VERB = Verb(
    name="run",
    order=7,
    summary="All steps from an experiment file to its report: body, generate, train, simulate, report.",
    example="softprint run examples/jelly3d_small.toml",
    run=run,
    needs=("dolfinx", "mpi4py", "h5py", "torch", "jinja2", "matplotlib", "pyvista"),
    configure=configure,
)
