"""`softprint train`: trains corrections on the truth file of a run."""

from __future__ import annotations

import argparse

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the option of this command."""
    parser.add_argument(
        "--model",
        action="append",
        metavar="NAME",
        help="one of [[training.models]] and [[training.internal]]; repeatable (default: all)",
    )


def run(options: argparse.Namespace, context: Context) -> int:
    """Train the models of the experiment that do not exist yet; writes corrections/NAME.safetensors and
    NAME.json, and internal/NAME.safetensors and NAME.json of internal corrections."""
    from softprint.surrogate.run_training import train_models

    if context.rank == 0:
        train_models(context, options.model)
    return 0


VERB = Verb(
    name="train",
    order=30,
    summary="Train corrections on the truth file; resumes, and keeps what held-out samples bear out.",
    example="softprint train examples/jelly3d_small.toml",
    run=run,
    configure=configure,
    needs=("h5py", "torch", "safetensors"),
)
