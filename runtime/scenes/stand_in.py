"""A new shape for a scene: a mesh file, a polygon file or a shape of the library in the place of a collider."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runtime.arrays import Array
from runtime.colliders.build import build_collider
from runtime.colliders.mesh_collider import SUFFIXES, read_surface
from runtime.colliders.polygon import load_polygon
from runtime.errors import SoftprintError
from runtime.experiment.colliders_schema import ColliderSpec, LibrarySpec, MeshSpec, PolygonSpec
from runtime.shapes import SCENE_SHAPES, SHAPES

if TYPE_CHECKING:
    from runtime.experiment import Experiment, SceneSpec


def with_stand_in(
    experiment: Experiment, scene: SceneSpec, asked: str, scale: float | None = None
) -> tuple[Experiment, SceneSpec]:
    """The experiment and the scene with another collider.

    asked: `FILE`, `SHAPE` or `COLLIDER=FILE`: a file or a shape of the library, and which of the scene's colliders it
    stands in for, the first if none is named. scale: metres for each unit of the file; by default the new shape is made
    as large as the one that it stands in for. The scene is then called `SCENE_with_SHAPE`.
    """
    role, _, source = asked.rpartition("=")
    names = [entry.name for entry in scene.colliders]
    if not names or (role and role not in names):
        wanted = f"no collider '{role}'" if role else "no collider to stand in for"
        raise SoftprintError(
            f"--collider {asked}: scene '{scene.name}' has {wanted}; it has {', '.join(names) or 'none'}"
        )
    replaced = role or names[0]
    size = build_collider(experiment.collider(replaced), experiment.base_dir).size
    if scale is None and not np.isfinite(size):
        raise SoftprintError(
            f"--collider {asked}: '{replaced}' has no size that the new shape could take; give --collider-scale"
        )
    spec = _spec(experiment.dim, asked, source, size, scale)
    if spec.name in experiment.collider_names and spec.name != replaced:
        # A shape of the library or of the file, at another size.
        spec = spec.model_copy(update={"name": f"{spec.name}_stand_in"})
    others = tuple(own for own in experiment.colliders if own.name != spec.name)
    entries = tuple(
        entry.model_copy(update={"name": spec.name}) if entry.name == replaced else entry
        for entry in scene.colliders
    )
    changed = scene.model_copy(update={"name": f"{scene.name}_with_{spec.name}", "colliders": entries})
    return experiment.with_colliders((*others, spec), f"--collider {asked}"), changed


def _spec(dim: int, asked: str, source: str, size: float, scale: float | None) -> ColliderSpec:
    """The table that describes the new shape."""
    path = Path(source)
    if dim == 3 and source in {**SHAPES, **SCENE_SHAPES}:
        return LibrarySpec(shape="library", name=source, entry=source, size=scale or size)
    if dim == 3 and path.suffix.lower() in SUFFIXES:
        vertices, _ = read_surface(path)
        return MeshSpec(
            shape="mesh", name=path.stem, file=path.absolute(), scale=scale or size / _half_extent(vertices)
        )
    if dim == 2 and path.suffix.lower() == ".txt":
        vertices = load_polygon(path)
        return PolygonSpec(
            shape="polygon",
            name=path.stem,
            file=path.absolute(),
            scale=scale or size / _half_extent(vertices),
        )
    right = (
        "an STL, OBJ or PLY file, or the name of a shape of the library"
        if dim == 3
        else "a text file with two columns"
    )
    raise SoftprintError(f"--collider {asked}: a collider in {dim}D is {right}")


def _half_extent(vertices: Array) -> float:
    """Half of the largest extent."""
    with np.errstate(invalid="ignore"):
        half = 0.5 * float((vertices.max(axis=0) - vertices.min(axis=0)).max())
    if not (np.isfinite(half) and half > 0):
        raise SoftprintError("the new collider's surface has no extent, or vertices that are not numbers")
    return half
