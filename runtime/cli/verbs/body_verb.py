"""`softprint body`: from a mesh to a reduced body."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path
from typing import TYPE_CHECKING

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb

if TYPE_CHECKING:
    from softprint.runtime.body import ReducedBody

log = logging.getLogger(__name__)


def run(options: argparse.Namespace, context: Context) -> int:
    """Build body.h5 in the run directory, unless it exists and was made from the same table, mesh and seed."""
    from softprint.runtime.body import save_body
    from softprint.runtime.scenes.experiment_body import body_of_experiment, recipe_of_experiment

    if context.rank > 0:
        return 0
    experiment, path = context.experiment, context.out_dir / "body.h5"
    recipe = recipe_of_experiment(experiment)
    body = _kept_body(path, recipe) if context.resume else None
    if body is not None:
        context.say(f"{path} is up to date.")
    else:
        with context.stage("building the body"):
            body = body_of_experiment(experiment)
            save_body(path, body, recipe)
        context.say(f"{path} written.")
    for label, value in describe(body):
        context.say(f"  {label:<12} {value}")
    return 0


def _kept_body(path: Path, recipe: str) -> ReducedBody | None:
    """The body that an earlier run made from the same inputs; None if there is none, or it is damaged."""
    from softprint.runtime.body import load_body, read_recipe
    from softprint.runtime.errors import SoftprintError

    try:
        return load_body(path) if path.is_file() and read_recipe(path) == recipe else None
    except SoftprintError as error:
        log.warning("%s; it is made again", error)
        return None


def describe(body: ReducedBody) -> list[tuple[str, str]]:
    """The main figures of a body, as labels and values."""
    mesh, cubature, dim = body.mesh, body.cubature, body.dim
    kind, unit = ("triangles", "kg/m") if dim == 2 else ("tetrahedra", "kg")
    extent = " x ".join(f"{length:.4g}" for length in mesh.points.max(axis=0) - mesh.points.min(axis=0))
    frames = ", ".join(f"{frame.name} ({len(frame.nodes)} nodes)" for frame in body.handles.frames) or "none"
    young = body.material.young
    stiffness = (
        f"{young.min():.4g}" if young.min() == young.max() else f"{young.min():.4g} to {young.max():.4g}"
    )
    return [
        ("mesh", f"{mesh.n_nodes:,} nodes, {mesh.n_cells:,} {kind}, {extent} m"),
        (
            "surface",
            f"{len(mesh.surface_nodes):,} nodes, {len(body.surface.nodes):,} contact points at run time",
        ),
        ("handles", f"{body.handles.n_points} points; frames: {frames}"),
        ("basis", f"{body.subspace.replace('_', ' ')}, {body.n_rows} rows, {body.n_dofs} minimal coordinates"),
        ("material", f"{body.material.model}, Young's modulus {stiffness} Pa"),
        ("mass", f"{body.node_mass.sum():.4g} {unit}"),
        (
            "cubature",
            f"{len(cubature.cells)} cells; against full integration: energy {cubature.energy_error:.2%}, "
            f"force {cubature.force_error:.2%} (mean of random states)",
        ),
        ("hash", body.content_hash[:16]),
    ]


VERB = Verb(
    name="body",
    order=10,
    summary="Build the reduced body: checked mesh, handles, subspace basis, mass and cubature.",
    example="softprint body examples/jelly3d_small.toml",
    run=run,
    needs=("h5py", "igl", "meshio"),
)
