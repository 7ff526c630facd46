"""The body of a run directory: read from its file, or built and saved there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softprint.runtime.cli.context import Context
from softprint.runtime.errors import SoftprintError

if TYPE_CHECKING:
    from softprint.runtime.body import ReducedBody
    from softprint.runtime.experiment import Experiment


def body_of_experiment(experiment: Experiment) -> ReducedBody:
    """Build the body that the experiment's [body] table describes; errors name the experiment file."""
    from softprint.runtime.body import build_body

    try:
        return build_body(experiment.body, experiment.base_dir, experiment.seed, experiment.dim)
    except SoftprintError as error:
        raise SoftprintError(f"{experiment.path}: [body] {error}") from error


def body_of_run(context: Context) -> ReducedBody:
    """body.h5 of the run directory, built if it does not exist.

    Raises SoftprintError if the file contains another body than the experiment's [body] table describes.
    """
    from softprint.runtime.body import body_recipe, load_body, save_body

    path = context.out_dir / "body.h5"
    if not path.is_file():
        context.say("building the body")
        experiment = context.experiment
        with context.stage("building the body"):
            body = body_of_experiment(experiment)
            save_body(path, body, body_recipe(experiment.body, experiment.base_dir, experiment.seed))
        return body
    body = load_body(path)
    difference = _difference(context, body)
    if difference:
        raise SoftprintError(
            f"{path} contains another body than the experiment's [body] table describes (its {difference} "
            "differs): make it again with `softprint body`, or choose another --out"
        )
    return body


def _difference(context: Context, body: ReducedBody) -> str:
    """The part of the body that differs from the experiment; empty if none. Basis and cubature follow from the rest."""
    from softprint.runtime.body.build import material_of_cells
    from softprint.runtime.body.placement import frames_of, place_handles
    from softprint.runtime.mesh import read_mesh

    experiment = context.experiment
    spec = experiment.body
    mesh = read_mesh(experiment.base_dir / spec.mesh)
    if not (np.array_equal(mesh.points, body.mesh.points) and np.array_equal(mesh.cells, body.mesh.cells)):
        return "mesh"
    handles = place_handles(mesh, spec.handles.points, frames_of(mesh, spec.handles.frames))
    named = [(frame.name, frame.nodes.tolist()) for frame in handles.frames]
    if named != [(frame.name, frame.nodes.tolist()) for frame in body.handles.frames] or not np.array_equal(
        handles.points, body.handles.points
    ):
        return "set of handles"
    for key in ("subspace", "hold"):
        if getattr(spec.handles, key) != getattr(body, key):
            return key
    material, density = material_of_cells(mesh, spec.material)
    same = material.model == body.material.model and all(
        np.array_equal(a, b)
        for a, b in (
            (material.young, body.material.young),
            (material.poisson, body.material.poisson),
            (density, body.density),
        )
    )
    if not same:
        return "material"
    at_most = min(spec.surface.samples, len(mesh.surface_nodes))
    return "" if len(body.surface.nodes) == at_most else "number of surface samples"
