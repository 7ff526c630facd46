"""Pictures of files: bodies, truths, motions, meshes and colliders."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.drawing.draw import draw
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.kind import Part, find_kind

if TYPE_CHECKING:
    from softprint.runtime.colliders.collider import Collider
    from softprint.runtime.colliders.pose import RigidPose

    Poses = Mapping[str, RigidPose]


def picture_of(path: Path, part: Part, picture: Path, experiment: Path | None) -> None:
    """Draw the file; SoftprintError if its kind cannot be drawn. experiment: defines the colliders of a sample or a
    frame; None to leave them out."""
    kind = find_kind(path)
    if kind.scene is None:
        raise SoftprintError(f"{path}: this kind of file cannot be drawn")
    draw(picture, kind.scene(path, part, experiment))


def known_colliders(names: Iterable[str], experiment: Path) -> dict[str, Collider]:
    """The colliders of those names from an experiment file; SoftprintError if one is missing."""
    from softprint.runtime.colliders.build import build_collider
    from softprint.runtime.experiment import load_experiment

    known = load_experiment(experiment)
    colliders = {}
    for name in names:
        if name not in known.collider_names:
            own = ", ".join(spec.name for spec in known.colliders) or "none"
            raise SoftprintError(f"{experiment}: has no collider {name!r}; its colliders: {own}")
        colliders[name] = build_collider(known.collider(name), known.base_dir)
    return colliders


def placed_surfaces(colliders: Mapping[str, Collider], poses: Poses) -> list[tuple[Array, IntArray]]:
    """The surfaces of colliders at their poses; planes, which are unbounded, are left out."""
    from softprint.runtime.colliders.level_set import placed_surface

    surfaces = (placed_surface(colliders[name], pose) for name, pose in poses.items())
    return [surface for surface in surfaces if surface is not None]
