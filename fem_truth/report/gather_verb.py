"""`softprint gather`: combines the reports of many bodies on one page."""

from __future__ import annotations

import argparse
from pathlib import Path

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments: the runs and the output page."""
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="run directories with a report on unseen shapes"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("gathered.html"), metavar="PAGE.html", help="default: gathered.html"
    )


def run(args: argparse.Namespace, context: Context) -> int:
    """Print the tables; write PAGE.html and PAGE.json."""
    from softprint.fem_truth.report.gather import gather, table_lines
    from softprint.runtime.errors import SoftprintError

    if args.out.suffix.lower() != ".html":
        raise SoftprintError(
            f"--out {args.out}: the page must be an .html file; its numbers are written beside it as .json"
        )
    for line in table_lines(gather(args.runs, args.out)):
        context.say(line)
    context.say(f"page: {args.out}")
    return 0


VERB = Verb(
    name="gather",
    order=55,
    summary="Put the reports of many bodies on one page (thesis, table 6.1).",
    example="softprint gather runs/ball_small runs/finger_small --out bodies.html",
    run=run,
    needs=("jinja2", "matplotlib"),
    configure=configure,
    reads_experiment=False,
)
