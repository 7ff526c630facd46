"""The body of a run directory: read from its file, or built and saved there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softprint.runtime.cli.context import Context

if TYPE_CHECKING:
    from softprint.runtime.body import ReducedBody


def body_of_run(context: Context) -> ReducedBody:
    """body.h5 of the run directory, built if it does not exist.

    Raises SoftprintError if the file contains another body than the experiment's [body] table describes.
    """
    from softprint.runtime.body import save_body
    from softprint.runtime.scenes.experiment_body import (
        body_of_experiment,
        load_body_of,
        recipe_of_experiment,
    )

    path, experiment = context.out_dir / "body.h5", context.experiment
    if path.is_file():
        return load_body_of(experiment, path)
    context.say("building the body")
    with context.stage("building the body"):
        body = body_of_experiment(experiment)
        save_body(path, body, recipe_of_experiment(experiment))
    return body
