"""The colliders of a motion, stored as tables in its file, so that they can be drawn without the experiment."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import TypeAdapter, ValidationError

from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.kinds.registry import ColliderSpec
from softprint.runtime.colliders.kinds.table import ColliderTable
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.sources import with_absolute_paths

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment, SceneSpec

_TABLES: TypeAdapter[tuple[ColliderSpec, ...]] = TypeAdapter(tuple[ColliderSpec, ...])


def collider_tables(experiment: Experiment, scene: SceneSpec) -> str:
    """The [[colliders]] tables of a scene as JSON; with absolute paths of the files that they name."""
    names = dict.fromkeys(entry.name for entry in scene.colliders)
    return tables_as_json([experiment.collider(name) for name in names], experiment.base_dir)


def tables_as_json(tables: Sequence[ColliderTable], base_dir: Path) -> str:
    """Tables as JSON; with absolute paths of the files that they name relative to base_dir."""
    absolute = tuple(with_absolute_paths(table, base_dir) for table in tables)
    return _TABLES.dump_json(absolute, exclude_none=True).decode()


def build_colliders(tables: str, source: Path) -> dict[str, Collider]:
    """The colliders of such tables by name; source: the file that the tables are from.

    Raises SoftprintError if the tables are invalid, or a file that they name is missing.
    """
    try:
        specs = _TABLES.validate_json(tables)
    except ValidationError as error:
        raise SoftprintError(f"{source}: its collider tables are invalid: {error}") from error
    try:
        return {spec.name: build_collider(spec) for spec in specs}
    except SoftprintError as error:
        raise SoftprintError(f"{source}: one of its colliders cannot be built: {error}") from error
