"""Kinematic handles: not solved for, but held, or led along a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array, IntArray
from runtime.body.handles import Handles
from runtime.colliders.path import KeyframedPath


@dataclass(frozen=True, eq=False)
class KinematicHandle:
    """handle: a point by number or a frame by name. path: how it moves *from rest*: its position is the
    displacement of the point, or of the frame's pivot [m], its rotation turns the frame about the pivot; None
    holds it at rest."""

    handle: int | str
    path: KeyframedPath | None = None


def free_dofs(handles: Handles, kinematic: Sequence[KinematicHandle]) -> IntArray:
    """(n_free,) the minimal coordinates that are left to solve for."""
    free = np.ones(handles.n_dofs, dtype=bool)
    for held in kinematic:
        free[handles.dofs_of(held.handle)] = False
    return np.flatnonzero(free)


def place_kinematic(
    rows: Array, rest_rows: Array, handles: Handles, kinematic: Sequence[KinematicHandle], time: float
) -> Array:
    """Rows with every kinematic handle where it has to be at ``time`` [s]."""
    placed = rows.copy()
    for held in kinematic:
        at = handles.rows_of(held.handle)
        placed[at] = rest_rows[at]
        if held.path is None:
            continue
        pose = held.path.pose(time)
        if isinstance(held.handle, str):
            pivot = handles.position(rest_rows, held.handle)
            translation = pivot + pose.translation - pose.rotation @ pivot
            placed = handles.with_frame(placed, held.handle, pose.rotation, translation)
        else:
            placed[at] += pose.translation
    return placed
