"""The colliders of a motion: their tables as its file holds them, so that they can be drawn without the experiment."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import TypeAdapter, ValidationError

from runtime.colliders.build import build_collider
from runtime.colliders.collider import Collider
from runtime.errors import SoftprintError
from runtime.experiment.colliders_schema import ColliderSpec
from runtime.experiment.sources import with_whole_paths

if TYPE_CHECKING:
    from runtime.experiment import Experiment, SceneSpec

_TABLES: TypeAdapter[tuple[ColliderSpec, ...]] = TypeAdapter(tuple[ColliderSpec, ...])


def collider_tables(experiment: Experiment, scene: SceneSpec) -> str:
    """The [[colliders]] tables of a scene as JSON; the files that they name by their whole paths."""
    names = dict.fromkeys(entry.name for entry in scene.colliders)
    tables = tuple(with_whole_paths(experiment.collider(name), experiment.base_dir) for name in names)
    return _TABLES.dump_json(tables, exclude_none=True).decode()


def build_colliders(tables: str, source: Path) -> dict[str, Collider]:
    """The colliders of such tables by name; source: where the tables were read.

    Raises SoftprintError where they cannot be understood, or a file of theirs is no longer where it was.
    """
    try:
        specs = _TABLES.validate_json(tables)
    except ValidationError as error:
        raise SoftprintError(f"{source}: its colliders cannot be understood: {error}") from error
    try:
        return {spec.name: build_collider(spec) for spec in specs}
    except SoftprintError as error:
        raise SoftprintError(f"{source}: a collider of it cannot be made again: {error}") from error
