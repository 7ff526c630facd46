"""`softprint verify`: problems whose answers are known from elsewhere, and ours beside them."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from runtime.cli.context import Context
from runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """Which cases, how thoroughly, and where to."""
    parser.add_argument("cases", nargs="*", metavar="CASE", help="cases to run (default: all, see --list)")
    parser.add_argument("--quick", action="store_true", help="coarse meshes and loose bounds: seconds a case")
    parser.add_argument("--list", action="store_true", help="say what cases there are, and run none")
    parser.add_argument(
        "--out", type=Path, default=Path("runs/verify"), metavar="DIR", help="where verify.html and .json go"
    )


def run(options: argparse.Namespace, context: Context) -> int:
    """verify.html and verify.json in the output folder, a table on the terminal; 1 if anything failed."""
    from fem_truth.verify import table
    from fem_truth.verify.cases import CASES
    from fem_truth.verify.suite import run_case, select
    from fem_truth.verify.write import write_page

    chosen = select(CASES, options.cases)
    if context.rank > 0:  # one process is enough
        return 0
    if options.list:
        for case in chosen:
            context.say(f"{case.name:<22} {case.title}")
        return 0
    context.out = options.out
    folder = context.out_dir  # refused now, and not after minutes of work
    context.say(table.header())
    outcomes = []
    for case in chosen:  # said before it runs, so that one sees what takes its time
        context.say(f"\n{case.name}: {case.title}")
        with _quiet():
            outcomes.append(run_case(case, options.quick))
        context.say("\n".join(table.lines(outcomes[-1])))
    page = write_page(outcomes, folder, options.quick)
    context.say(f"\n{table.summary(outcomes)}")
    context.say(f"page: {page}")
    return 0 if all(outcome.passed for outcome in outcomes) else 1


@contextmanager
def _quiet() -> Iterator[None]:
    """Keeps to itself what meshes, bodies and every assembly of scikit-fem log: the cases make many."""
    loggers = [logging.getLogger(name) for name in ("runtime", "fem_truth", "skfem")]
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
    summary="Hold the solvers against closed forms, published benchmarks and another library.",
    example="softprint verify cook hertz",
    run=run,
    needs=("dolfinx", "jinja2", "matplotlib"),
    configure=configure,
    reads_experiment=False,
)
