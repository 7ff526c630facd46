"""`softprint report`: evaluates the models on the held-out motions; writes a page and a JSON file."""

from __future__ import annotations

import argparse

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the option to leave out the renderings."""
    parser.add_argument(
        "--no-pictures", action="store_true", help="leave out the renderings (keep numbers and plots)"
    )


def run(args: argparse.Namespace, context: Context) -> int:
    """Write report.html and report.json in the run directory, unless they would be the same as those there; full-space
    solves are kept in heldout/ and reused."""
    from softprint.fem_truth.report.made_report import MadeReport

    pictures = not args.no_pictures
    made = kept = MadeReport.kept(context, pictures)
    if made is None:
        # Imported here, because DOLFINx takes seconds to load.
        from softprint.fem_truth.report.make import make_report

        made = make_report(context, pictures)
    for line in made.headline:
        context.say(line)
    context.say(f"report: {made.page}{' (kept)' if kept else ''}")
    context.say(f"numbers: {made.numbers}")
    return 0


VERB = Verb(
    name="report",
    order=50,
    summary="Evaluate the models on the held-out motions: report.html and report.json.",
    example="softprint report examples/jelly3d_small.toml",
    run=run,
    needs=("dolfinx", "h5py", "jinja2", "matplotlib", "pyvista"),
    configure=configure,
)
