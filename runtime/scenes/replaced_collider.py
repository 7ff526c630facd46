"""Replace a collider of a scene by another shape: a mesh file, a polygon file or a shape of the library."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.kinds.library import LibrarySpec
from softprint.runtime.colliders.kinds.mesh import MeshSpec
from softprint.runtime.colliders.kinds.polygon import PolygonSpec
from softprint.runtime.colliders.kinds.table import ColliderTable
from softprint.runtime.colliders.sampled.polygon import load_polygon
from softprint.runtime.colliders.surface_mesh.mesh_collider import SUFFIXES, read_surface
from softprint.runtime.errors import SoftprintError
from softprint.runtime.shapes import SCENE_SHAPES, SHAPES

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment, SceneSpec


def with_replaced_collider(
    experiment: Experiment, scene: SceneSpec, option: str, scale: float | None = None
) -> tuple[Experiment, SceneSpec]:
    """The experiment and the scene with one collider replaced.

    option: `FILE`, `SHAPE` or `COLLIDER=FILE`: a file or a shape of the library, and the collider of the scene that it
    replaces, the first if none is named. scale: metres for each unit of the file; by default the new shape gets the
    size of the one that it replaces. The scene is renamed `SCENE_with_SHAPE`.
    """
    role, _, source = option.rpartition("=")
    names = [entry.name for entry in scene.colliders]
    if not names or (role and role not in names):
        wanted = f"no collider '{role}'" if role else "no collider to replace"
        raise SoftprintError(
            f"--collider {option}: scene '{scene.name}' has {wanted}; it has {', '.join(names) or 'none'}"
        )
    replaced = role or names[0]
    size = build_collider(experiment.collider(replaced), experiment.base_dir).size
    if scale is None and not np.isfinite(size):
        raise SoftprintError(
            f"--collider {option}: '{replaced}' has no size that the new shape could get; give --collider-scale"
        )
    spec = _spec(experiment.dim, option, source, size, scale)
    if spec.name in experiment.collider_names and spec.name != replaced:
        # A shape of the library or of the file, at another size.
        spec = spec.model_copy(update={"name": f"{spec.name}_stand_in"})
    others = tuple(own for own in experiment.colliders if own.name != spec.name)
    entries = tuple(
        entry.model_copy(update={"name": spec.name}) if entry.name == replaced else entry
        for entry in scene.colliders
    )
    changed = scene.model_copy(update={"name": f"{scene.name}_with_{spec.name}", "colliders": entries})
    return experiment.with_colliders((*others, spec), f"--collider {option}"), changed


def _spec(dim: int, option: str, source: str, size: float, scale: float | None) -> ColliderTable:
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
    raise SoftprintError(f"--collider {option}: a collider in {dim}D is {right}")


def _half_extent(vertices: Array) -> float:
    """Half of the largest extent."""
    with np.errstate(invalid="ignore"):
        half = 0.5 * float((vertices.max(axis=0) - vertices.min(axis=0)).max())
    if not (np.isfinite(half) and half > 0):
        raise SoftprintError("the new collider's surface has no extent, or vertices that are not numbers")
    return half
