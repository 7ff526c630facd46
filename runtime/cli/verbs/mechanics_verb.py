"""`softprint mechanics`: the linear mechanics of a body at rest, which learned contact forces build on."""

from __future__ import annotations

import argparse

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """The number of contact nodes."""
    parser.add_argument(
        "--contact-nodes",
        metavar="N",
        type=_count,
        help="limit of surface nodes that carry contact forces (default: that of the experiment's models)",
    )


def run(options: argparse.Namespace, context: Context) -> int:
    """Make mechanics_N.safetensors in the run directory, unless it exists for this body and gravity; needs no truth."""
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.cli.run_mechanics import RunMechanics

    if context.rank > 0:
        return 0
    mechanics = RunMechanics(context, body_of_run(context))
    for count in [options.contact_nodes] if options.contact_nodes else _requested_counts(context):
        header, found = mechanics.get(count)
        context.say(
            f"{mechanics.path(count)}: {len(found.surface_compliance.nodes):,} contact nodes, static condensation "
            f"under gravity {header.gravity} m/s^2, hash {header.content_hash[:16]}"
        )
    return 0


def _count(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"should be a whole number of at least 1 (got {text})")
    return int(text)


def _requested_counts(context: Context) -> list[int]:
    """Numbers of contact nodes of the experiment's models; the default if it has no models."""
    from softprint.runtime.experiment import ModelSpec
    from softprint.runtime.learned.form import find_form

    models = context.experiment.training.models
    counts = {model.contact_nodes for model in models if find_form(model.form).needs_mechanics}
    return sorted(counts or {ModelSpec(name="default").contact_nodes})


VERB = Verb(
    name="mechanics",
    order=15,
    summary="Compute the body's linear mechanics: surface compliance and static condensation.",
    example="softprint mechanics examples/jelly3d_small.toml",
    run=run,
    configure=configure,
    needs=("h5py", "safetensors"),
)
