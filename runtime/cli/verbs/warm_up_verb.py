"""`softprint warm-up`: compile the simulation kernels ahead of the first step."""

from __future__ import annotations

import argparse
import logging
from time import perf_counter

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def run(options: argparse.Namespace, context: Context) -> int:
    """Compile the kernels that are not cached on disk yet: most of a minute on a fresh installation, seconds after
    that."""
    from softprint.runtime.scenes.warm_up import n_scenes, warm_up

    logging.getLogger("softprint").setLevel(logging.WARNING)  # no log lines about the meshes that it makes

    started = perf_counter()
    with context.progress(n_scenes(), "scenes", "compiling kernels") as bar:
        warm_up(progress=bar.update)
    context.say(f"kernels are compiled ({perf_counter() - started:.0f} s)")
    return 0


VERB = Verb(
    name="warm-up",
    order=6,
    summary="Compile the simulation kernels ahead of the first step.",
    example="softprint warm-up",
    run=run,
    needs=("igl", "torch"),
    reads_experiment=False,
)
