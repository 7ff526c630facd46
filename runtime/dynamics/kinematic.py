"""Kinematic handles: not solved for, but fixed or moved along a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.handles import Handles
from softprint.runtime.colliders.path import KeyframedPath
from softprint.runtime.errors import SoftprintError


@dataclass(frozen=True, eq=False)
class KinematicHandle:
    """handle: a point by number or a frame by name. path: its motion *from rest*: its position is the displacement of
    the point, or of the frame's pivot [m], its rotation rotates the frame about the pivot; None fixes the handle at
    rest."""

    handle: int | str
    path: KeyframedPath | None = None


def free_dofs(handles: Handles, kinematic: Sequence[KinematicHandle]) -> IntArray:
    """(n_free,) the minimal coordinates that are solved for."""
    free = np.ones(handles.n_dofs, dtype=bool)
    for fixed in kinematic:
        own = handles.dofs_of(fixed.handle)
        if not free[own].any():
            raise SoftprintError(f"handle {fixed.handle!r} is given twice: it is either fixed or moved along one path")
        free[own] = False
    return np.flatnonzero(free)


def place_kinematic(
    rows: Array, rest_rows: Array, handles: Handles, kinematic: Sequence[KinematicHandle], time: float
) -> Array:
    """Rows with every kinematic handle at its prescribed position at ``time`` [s]."""
    placed = rows.copy()
    for fixed in kinematic:
        at = handles.rows_of(fixed.handle)
        placed[at] = rest_rows[at]
        if fixed.path is None:
            continue
        pose = fixed.path.pose(time)
        if isinstance(fixed.handle, str):
            pivot = handles.position(rest_rows, fixed.handle)
            translation = pivot + pose.translation - pose.rotation @ pivot
            placed = handles.with_frame(placed, fixed.handle, pose.rotation, translation)
        else:
            placed[at] += pose.translation
    return placed
