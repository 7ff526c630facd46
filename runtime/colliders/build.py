"""Colliders from the tables of an experiment file; the tables of all kinds: `kinds/registry.py`."""

from __future__ import annotations

from pathlib import Path

from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.combine import Placed
from softprint.runtime.colliders.kinds.table import ColliderTable
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.errors import SoftprintError


def build_collider(spec: ColliderTable, base_dir: Path = Path()) -> Collider:
    """The collider that `spec` describes; files are looked for relative to `base_dir`.

    Raises SoftprintError for missing or unusable files and for invalid combinations of shapes.
    """
    collider = spec.make(spec.name or spec.shape, base_dir)
    if spec.position is None and spec.rotation is None:
        return collider
    position = [0.0] * collider.dim if spec.position is None else spec.position
    rotation = [0.0] * (1 if collider.dim == 2 else 3) if spec.rotation is None else spec.rotation
    if len(position) != collider.dim:
        raise SoftprintError(
            f"collider '{collider.name}' is {collider.dim}D, so its position needs {collider.dim} numbers; "
            f"got {position}"
        )
    return Placed(collider, RigidPose.from_rotation_vector(rotation, position))
