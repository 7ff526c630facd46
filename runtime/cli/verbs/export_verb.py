"""`softprint export`: write body and truth in the layout of the data published with the thesis's papers."""

from __future__ import annotations

import argparse

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb

FOLDER = "published"


def configure(parser: argparse.ArgumentParser) -> None:
    """The collider."""
    parser.add_argument(
        "--collider",
        metavar="NAME",
        help="the collider of the samples, such as a shape of the library (default: that of the [sampling] table)",
    )


def run(args: argparse.Namespace, context: Context) -> int:
    """Write published/meshes.h5 and published/dataset.h5 into the run directory."""
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.colliders.build import build_collider
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.published.export import export_published, published_samples
    from softprint.runtime.truth.truth_colliders import require_same_colliders
    from softprint.runtime.truth.truth_file import load_truth

    experiment = context.experiment
    name = args.collider or experiment.sampling.collider
    if name not in experiment.collider_names:
        of_one = (
            "a data set has one collider" if len(experiment.sampled_colliders) > 1 else "it does not exist"
        )
        raise SoftprintError(
            f"{experiment.path}: no collider {name!r} to export, {of_one}; name one with --collider"
        )
    body = body_of_run(context)
    collider = build_collider(experiment.collider(name), experiment.base_dir)
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        require_same_colliders(truth, experiment)
        total, all_samples = len(published_samples(truth, collider)), truth.n_samples
        with context.progress(total, "samples", "export") as bar:
            meshes, dataset, count = export_published(
                context.out_dir / FOLDER, truth, body, collider, bar.update
            )
    context.say(f"{meshes}: W, q_ref, tris, tets of {body.name}; W, z_ref, tris of {collider.name}")
    context.say(
        f"{dataset}: q, z, x of {count} samples; {all_samples - count} are not usable for training, or "
        f"are of other colliders"
    )
    return 0


VERB = Verb(
    name="export",
    order=46,
    summary="Body and truth in the HDF5 layout published with the thesis's papers (motions: see convert).",
    example="softprint export examples/jelly3d_small.toml",
    run=run,
    needs=("h5py",),
    configure=configure,
)
