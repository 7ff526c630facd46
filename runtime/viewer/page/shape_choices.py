"""The shapes that a user can choose by name: those of the experiment, formulas, and the library."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from softprint.runtime.colliders.kinds.library import LibrarySpec
from softprint.runtime.colliders.kinds.mesh import MeshSpec
from softprint.runtime.colliders.kinds.registry import ColliderSpec
from softprint.runtime.colliders.kinds.table import ColliderTable
from softprint.runtime.colliders.surface_mesh.mesh_collider import SUFFIXES, read_surface
from softprint.runtime.errors import SoftprintError
from softprint.runtime.shapes import SCENE_SHAPES, SHAPES

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment

_TABLE: TypeAdapter[ColliderTable] = TypeAdapter(ColliderSpec)
# By dimension: tables of half extent 1.
_FORMULAS: dict[int, dict[str, dict[str, Any]]] = {
    2: {
        "circle": {"shape": "circle", "radius": 1.0},
        "box": {"shape": "box", "half_extents": [1.0, 0.6]},
        "capsule": {"shape": "capsule", "start": [-0.6, 0.0], "end": [0.6, 0.0], "radius": 0.4},
        "cone": {
            "shape": "cone",
            "start": [0.0, 0.55],
            "end": [0.0, -0.85],
            "start_radius": 0.45,
            "end_radius": 0.15,
        },
    },
    3: {
        "sphere": {"shape": "sphere", "radius": 1.0},
        "box": {"shape": "box", "half_extents": [1.0, 0.7, 0.5]},
        "capsule": {"shape": "capsule", "start": [-0.6, 0.0, 0.0], "end": [0.6, 0.0, 0.0], "radius": 0.4},
        "cone": {
            "shape": "cone",
            "start": [0.0, 0.0, 0.55],
            "end": [0.0, 0.0, -0.85],
            "start_radius": 0.45,
            "end_radius": 0.15,
        },
        "cylinder": {"shape": "cylinder", "radius": 0.7, "half_height": 1.0},
    },
}


def choices(experiment: Experiment) -> list[str]:
    """Names of the shapes for bodies of this experiment; the experiment's own come first."""
    own = [table.name for table in experiment.colliders]
    library = [*SHAPES, *SCENE_SHAPES] if experiment.dim == 3 else []
    return list(dict.fromkeys([*own, *_FORMULAS[experiment.dim], *library]))


def table_of(experiment: Experiment, choice: str, size: float) -> ColliderTable:
    """The table of a shape with half its largest extent `size` [m]; a collider of the experiment keeps its own size.
    Raises SoftprintError for other names and sizes."""
    if choice in {table.name for table in experiment.colliders}:
        return experiment.collider(choice)
    if not (np.isfinite(size) and size > 0):
        raise SoftprintError(f"the size of a collider must be a positive number of metres, not {size}")
    if choice in _FORMULAS[experiment.dim]:
        table = {key: _scaled(value, size) for key, value in _FORMULAS[experiment.dim][choice].items()}
        return _checked({**table, "name": choice})
    if experiment.dim == 3 and choice in {**SHAPES, **SCENE_SHAPES}:
        return LibrarySpec(shape="library", name=choice, entry=choice, size=size)
    raise SoftprintError(f"there is no shape {choice!r}; there are {', '.join(choices(experiment))}")


def table_of_upload(folder: Path, name: str, content: bytes, size: float) -> ColliderTable:
    """Save an uploaded surface mesh in a folder, read it with all checks, and return its table.

    Raises SoftprintError where it is no STL, OBJ or PLY file, or unusable; nothing is then left of it.
    """
    suffix = Path(name).suffix.lower()
    if suffix not in SUFFIXES:
        raise SoftprintError(f"{_clean(name)}: a collider is an STL, OBJ or PLY file")
    stem = _clean(Path(name).stem)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{stem}{suffix}"
        number = 1
        while path.exists() and path.read_bytes() != content:
            number += 1
            path = folder / f"{stem}_{number}{suffix}"
        new = not path.exists()
        path.write_bytes(content)
    except OSError as error:
        raise SoftprintError(f"{folder}: the file cannot be saved there: {error.strerror}") from error
    table = MeshSpec(shape="mesh", name=path.stem, file=path.absolute(), size=size, centre=True)
    try:
        read_surface(path)
        table.make(path.stem, Path())
    except SoftprintError:
        if new:
            path.unlink(missing_ok=True)
        raise
    return table


def renamed(table: ColliderTable, taken: set[str]) -> ColliderTable:
    """The table under a name that is not taken."""
    name, number = table.name, 1
    while name in taken:
        number += 1
        name = f"{table.name}_{number}"
    changes: dict[str, object] = {"name": name}
    if isinstance(table, LibrarySpec):
        changes["entry"] = table.entry_name
    return table.model_copy(update=changes)


def _scaled(value: Any, size: float) -> Any:
    if isinstance(value, str):
        return value
    return [size * own for own in value] if isinstance(value, list) else size * value


def _checked(table: dict[str, Any]) -> ColliderTable:
    try:
        return _TABLE.validate_python(table)
    except ValidationError as error:
        raise SoftprintError(f"the collider {table['name']!r} is invalid: {error}") from error


def _clean(name: str) -> str:
    """A file name of letters, digits, - and _, without folders."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "_", Path(name).name).strip("_")[:40]
    return plain or "collider"
