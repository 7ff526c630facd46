"""`softprint keys`: the keys of an experiment file."""

from __future__ import annotations

import argparse

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """The section of the file."""
    parser.add_argument(
        "section", nargs="?", default="", help="only keys that start with this, such as sampling"
    )


def run(options: argparse.Namespace, context: Context) -> int:
    """Print every key with its type, default and meaning."""
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.experiment import Experiment
    from softprint.runtime.experiment.describe import described_keys

    chosen = [line for line in described_keys(Experiment) if line[0].startswith(options.section)]
    if not chosen:
        raise SoftprintError(
            f"no key of an experiment file starts with '{options.section}'; try softprint keys"
        )
    for key, kind, description in chosen:
        if kind in ("table", "tables"):
            context.say(f"\n{key:<34} {description}")
        else:
            context.say(f"  {key:<32} {description} ({kind})" if description else f"  {key:<32} {kind}")
    return 0


VERB = Verb(
    name="keys",
    order=5,
    summary="List every key of an experiment file: type, default and meaning.",
    example="softprint keys sampling",
    run=run,
    configure=configure,
    reads_experiment=False,
)
