"""The body that an experiment describes: built, or compared with one that was saved."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.body_file import load_body, read_recipe
from softprint.runtime.body.build import body_recipe, build_body, material_of_cells
from softprint.runtime.body.cubature import choose_cubature
from softprint.runtime.body.placement import frames_of, place_handles
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment
from softprint.runtime.mesh import read_mesh

# Of the cubature cells, that share may differ on another machine, where a weight vanishes by round-off.
_ROUND_OFF = 0.01


def body_of_experiment(experiment: Experiment) -> ReducedBody:
    """Build the body that the experiment's [body] table describes; errors name the experiment file."""
    try:
        return build_body(experiment.body, experiment.base_dir, experiment.seed, experiment.dim)
    except SoftprintError as error:
        raise SoftprintError(f"{experiment.path}: [body] {error}") from error


def recipe_of_experiment(experiment: Experiment) -> str:
    """A hash of all that its body is built from."""
    return body_recipe(experiment.body, experiment.base_dir, experiment.seed)


def load_body_of(experiment: Experiment, path: Path) -> ReducedBody:
    """The body of a file. Raises SoftprintError where it is another than the experiment's [body] table describes."""
    body = load_body(path)
    if read_recipe(path) == recipe_of_experiment(experiment):
        return body
    difference = _difference(experiment, body)
    if difference:
        raise SoftprintError(
            f"{path} contains another body than the experiment's [body] table describes (its {difference} "
            "differs): make it again with `softprint body`, or choose another --out"
        )
    return body


def _difference(experiment: Experiment, body: ReducedBody) -> str:
    """The part of the body that differs from the experiment; empty if none. The basis follows from the rest."""
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
    if len(body.surface.nodes) != at_most:
        return "number of surface samples"
    count = spec.cubature.points_per_row * handles.n_rows
    cells, _ = choose_cubature(mesh, body.basis, handles, material, count)
    others = np.setxor1d(cells, body.cubature.cells)
    return "cubature" if len(others) > _ROUND_OFF * len(cells) else ""
