"""`softprint train`: corrections from the truth file of a run."""

from __future__ import annotations

import argparse

from runtime.cli.context import Context
from runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """The verb's own option."""
    parser.add_argument(
        "--model", metavar="NAME", help="train only this one of [[training.models]] (default: all)"
    )


def run(options: argparse.Namespace, context: Context) -> int:
    """Train the models of the experiment that are not there yet; corrections/NAME.safetensors and
    NAME.json."""
    from surrogate.run_training import train_models

    if context.rank == 0:
        train_models(context, options.model)
    return 0


VERB = Verb(
    name="train",
    order=30,
    summary="Learn corrections from the truth file; resumes, and keeps the best weights on held-out states.",
    example="softprint train examples/jelly3d_small.toml",
    run=run,
    configure=configure,
    needs=("h5py", "torch", "safetensors"),
)
