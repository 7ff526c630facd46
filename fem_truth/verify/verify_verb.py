"""`softprint verify`: problems with independently known solutions, compared with ours."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments: cases, thoroughness and output folder."""
    parser.add_argument("cases", nargs="*", metavar="CASE", help="cases to run (default: all, see --list)")
    parser.add_argument(
        "--quick", action="store_true", help="coarse meshes and loose bounds: seconds per case"
    )
    parser.add_argument("--list", action="store_true", help="list the cases without running them")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("runs/verify"),
        metavar="DIR",
        help="output folder of verify.html and .json",
    )


def run(options: argparse.Namespace, context: Context) -> int:
    """Write verify.html and verify.json in the output folder and print a table; returns 1 if anything failed."""
    from softprint.fem_truth.verify import table
    from softprint.fem_truth.verify.cases import CASES
    from softprint.fem_truth.verify.suite import run_case, select
    from softprint.fem_truth.verify.write import write_page

    chosen = select(CASES, options.cases)
    if context.rank > 0:  # one process is enough
        return 0
    if options.list:
        for case in chosen:
            context.say(f"{case.name:<22} {case.title}")
        return 0
    context.out = options.out
    folder = context.out_dir  # raises an error now, and not after minutes of work
    context.say(table.header())
    outcomes = []
    for case in chosen:  # printed before it runs, so that a slow case is visible
        context.say(f"\n{case.name}: {case.title}")
        with _quiet(), context.stage(case.name):
            outcomes.append(run_case(case, options.quick))
        context.say("\n".join(table.lines(outcomes[-1])))
    page = write_page(outcomes, folder, options.quick)
    context.say(f"\n{table.summary(outcomes)}")
    context.say(f"page: {page}")
    return 0 if all(outcome.passed for outcome in outcomes) else 1


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress log messages of meshes, bodies and scikit-fem's assembly, of which the cases make many."""
    loggers = [logging.getLogger(name) for name in ("softprint", "skfem")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels):
            logger.setLevel(level)


VERB = Verb(
    name="verify",
    order=70,
    summary="Compare the solvers with closed forms, published benchmarks and another library.",
    example="softprint verify cook hertz",
    run=run,
    needs=("dolfinx", "jinja2", "matplotlib"),
    configure=configure,
    reads_experiment=False,
)
