"""What an experiment depends on besides its text: files that it names, and formulas of the library's shapes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from softprint.runtime.colliders.kinds.library import LibrarySpec
from softprint.runtime.colliders.kinds.registry import DifferenceSpec, UnionSpec
from softprint.runtime.colliders.kinds.table import ColliderTable
from softprint.runtime.io.files import content_hash, file_hash
from softprint.runtime.shapes import find_shape

if TYPE_CHECKING:
    from softprint.runtime.experiment.experiment import Experiment
    from softprint.runtime.experiment.schema.scene import SceneSpec


def collider_files(spec: ColliderTable, base_dir: Path, where: str = "") -> dict[str, str]:
    """SHA-256 of the file of a collider and of those of its parts, by where they stand in its table: "" its own,
    "parts[1]" that of its second part."""
    file = getattr(spec, "file", None)
    hashes = {} if file is None else {where: file_hash(base_dir / file)}
    for inside, part in _parts(spec):
        hashes |= collider_files(part, base_dir, f"{where}.{inside}" if where else inside)
    return hashes


def with_absolute_paths(spec: ColliderTable, base_dir: Path) -> ColliderTable:
    """The same collider wherever it is read from: the files that it and its parts name with their whole paths."""
    changes: dict[str, object] = {}
    file = getattr(spec, "file", None)
    if file is not None:
        changes["file"] = (base_dir / file).absolute()
    if isinstance(spec, UnionSpec | DifferenceSpec):
        changes["parts"] = [with_absolute_paths(part, base_dir) for part in spec.parts]
    if isinstance(spec, DifferenceSpec):
        changes["base"] = with_absolute_paths(spec.base, base_dir)
    return spec.model_copy(update=changes)


def scene_files(experiment: Experiment, scene: SceneSpec) -> dict[str, str]:
    """SHA-256 of the files that decide a scene, by what they are of."""
    hashes = {}
    for name in dict.fromkeys(entry.name for entry in scene.colliders):
        for where, digest in collider_files(experiment.collider(name), experiment.base_dir).items():
            hashes[f"collider_file_{name}{where and '.'}{where}"] = digest
    if scene.tracking is not None:
        hashes["tracking_file"] = file_hash(experiment.base_dir / scene.tracking.file)
    return hashes


def formulas_hash(experiment: Experiment, names: Sequence[str]) -> str | None:
    """One hash for the formulas of those of the colliders that are shapes of the library; None where none is."""
    shapes = {entry for name in names for entry in _library_entries(experiment.collider(name))}
    if not shapes:
        return None
    return content_hash({entry: find_shape(entry).formula_hash for entry in shapes})


def _parts(spec: ColliderTable) -> Iterator[tuple[str, ColliderTable]]:
    if isinstance(spec, DifferenceSpec):
        yield "base", spec.base
    if isinstance(spec, UnionSpec | DifferenceSpec):
        for number, part in enumerate(spec.parts):
            yield f"parts[{number}]", part


def _library_entries(spec: ColliderTable) -> Iterator[str]:
    if isinstance(spec, LibrarySpec):
        yield spec.entry_name
    for _, part in _parts(spec):
        yield from _library_entries(part)
