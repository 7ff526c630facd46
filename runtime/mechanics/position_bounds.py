"""Bounds on the positions of the nodes of a body, static condensation included, without evaluating every node.

Within a step x = U rows + u is affine in the rows, and the rows are close to the frame rows. With the change of the
position of handle h since then (dp, less the mean t over handles), the change of its rotation (dA), and V = U + L,

    |x_X(rows) - x_X(frame rows) - t| <= sum_h |V_Xp| |dp| + |V_XA| |dA|

in Frobenius norms. Rotations of frames are about their pivots and not about the origin, which may be far away, so that
the bound stays small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.handles import Handles
from softprint.runtime.compiled import summing
from softprint.runtime.linalg.row_products import placed
from softprint.runtime.mechanics.static_condensation import StaticCondensation


class PositionBounds:
    """Bounds for n nodes with basis U (n, n_rows) and their static condensation."""

    def __init__(self, basis: Array, condensation: StaticCondensation, handles: Handles) -> None:
        self._basis, dim = basis, handles.dim
        n_points, n_frames = handles.n_points, len(handles.frames)
        pivots = np.array([frame.pivot for frame in handles.frames]).reshape(n_frames, dim)
        # Map from rows to the positions of the handles, and the rows of their linear parts.
        self.places = np.zeros((n_points + n_frames, handles.n_rows))
        self.places[:n_points, :n_points] = np.eye(n_points)
        self.linear = n_points + (np.arange(n_frames)[:, None] * (dim + 1) + np.arange(dim))
        last = n_points + np.arange(n_frames) * (dim + 1) + dim
        for frame, pivot in enumerate(pivots):
            self.places[n_points + frame, self.linear[frame]] = pivot
            self.places[n_points + frame, last[frame]] = 1.0
        modes = condensation.modes.astype(np.float64)
        for axis in range(dim):
            modes[:, axis, :, axis] += basis
        moved = modes[:, :, np.r_[np.arange(n_points), last].astype(np.int64)]
        rotated = modes[:, :, self.linear] - pivots[:, :, None] * moved[:, :, n_points:, None]
        # Stored by handle, so that the inner loop of the sum is over nodes.
        by_place = np.sqrt(np.square(moved).sum(axis=(1, 3), dtype=np.float64))
        by_rotation = np.sqrt(np.square(rotated).sum(axis=(1, 3, 4), dtype=np.float64))
        self.by_place, self.by_rotation = (
            np.ascontiguousarray(by_place.T),
            np.ascontiguousarray(by_rotation.T),
        )

    def about(self, frame_rows: Array, condensed: Array) -> BoundedPositions:
        """The bounds of one step; condensed: u (n, dim) [m] of the nodes at the frame rows (n_rows, dim)."""
        return BoundedPositions(self, frame_rows, placed(self._basis, frame_rows) + condensed)


@dataclass(frozen=True, eq=False)
class BoundedPositions:
    """The bounds of one step; x: (n, dim) [m] at the frame rows."""

    bounds: PositionBounds
    frame_rows: Array
    x: Array

    def __call__(self, rows: Array) -> tuple[Array, Array]:
        """Approximate positions (n, dim) [m] and the bounds on their error (n,) [m]."""
        own, change = self.bounds, rows - self.frame_rows
        return _bounded(self.x, own.by_place, own.by_rotation, own.places @ change, change[own.linear])


@summing
def _bounded(
    x: Array, by_place: Array, by_rotation: Array, places: Array, rotations: Array
) -> tuple[Array, Array]:
    """x + t (n, dim) and the sum over the handles (n,). places: dp with its mean t included (h, dim); rotations: dA (f,
    dim, dim); by_place: |V_Xp| (h, n); by_rotation: |V_XA| (f, n)."""
    n, dim = x.shape
    shift = np.zeros(dim)
    for place in places:
        shift += place / len(places)
    position, reach = np.empty((n, dim)), np.zeros(n)
    for i in range(n):
        for a in range(dim):
            position[i, a] = x[i, a] + shift[a]
    for h in range(len(places)):
        far, row = np.sqrt(np.square(places[h] - shift).sum()), by_place[h]
        for i in range(n):
            reach[i] += row[i] * far
    for f in range(len(rotations)):
        far, row = np.sqrt(np.square(rotations[f]).sum()), by_rotation[f]
        for i in range(n):
            reach[i] += row[i] * far
    return position, reach
