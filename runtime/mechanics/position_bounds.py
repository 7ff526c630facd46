"""Where the nodes of a body may be, internal response included, without asking at every node.

Within a step x = U rows + u is affine in the rows, and they have not moved far since the turn was taken: with the
change of handle h since then, of where it is (dp, less its mean t) and of how it is turned (dA), V = U + L,

    |x_X(rows) - x_X(turn) - t| <= sum_h |V_Xp| |dp| + |V_XA| |dA|

in Frobenius norms. Frames change about their pivots, not about the far-away origin, for the sum to stay small.
"""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array, same
from runtime.body.handles import Handles
from runtime.compiled import summing
from runtime.linalg.row_products import placed
from runtime.mechanics.static_condensation import StaticCondensation


class PositionBounds:
    """Of n nodes, by their basis U (n, n_rows) and their response."""

    def __init__(self, basis: Array, internal: StaticCondensation, handles: Handles) -> None:
        self._basis, self._internal, dim = basis, internal, handles.dim
        n_points, n_frames = handles.n_points, len(handles.frames)
        pivots = np.array([frame.pivot for frame in handles.frames]).reshape(n_frames, dim)
        # From rows to the places of the handles, and back to what their translations and turns move.
        self._places = np.zeros((n_points + n_frames, handles.n_rows))
        self._places[:n_points, :n_points] = np.eye(n_points)
        self._linear = n_points + (np.arange(n_frames)[:, None] * (dim + 1) + np.arange(dim))
        last = n_points + np.arange(n_frames) * (dim + 1) + dim
        for frame, pivot in enumerate(pivots):
            self._places[n_points + frame, self._linear[frame]] = pivot
            self._places[n_points + frame, last[frame]] = 1.0
        modes = internal.modes.astype(np.float64)
        for axis in range(dim):
            modes[:, axis, :, axis] += basis
        moved = modes[:, :, np.r_[np.arange(n_points), last].astype(np.int64)]
        turned = modes[:, :, self._linear] - pivots[:, :, None] * moved[:, :, n_points:, None]
        # By handle, for the sum over them to be one over many nodes at once.
        by_place = np.sqrt(np.square(moved).sum(axis=(1, 3), dtype=np.float64))
        by_turn = np.sqrt(np.square(turned).sum(axis=(1, 3, 4), dtype=np.float64))
        self._by_place, self._by_turn = np.ascontiguousarray(by_place.T), np.ascontiguousarray(by_turn.T)
        self._last: tuple[Array, Array] | None = None

    def __call__(self, rows: Array, turn: Array) -> tuple[Array, Array]:
        """Positions (n, dim) and how far x may be from them (n,) [m]."""
        if self._last is None or not same(self._last[0], turn):
            self._last = turn.copy(), placed(self._basis, turn) + self._internal.displacement(turn, turn)
        change = rows - turn
        places = self._places @ change
        return _reached(self._last[1], self._by_place, self._by_turn, places, change[self._linear])


@summing
def _reached(x: Array, by_place: Array, by_turn: Array, places: Array, turns: Array) -> tuple[Array, Array]:
    """x + t (n, dim) and the sum over the handles (n,): of dp (h, dim), its mean t included, and dA (f, dim, dim);
    |V_Xp| (h, n), |V_XA| (f, n)."""
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
    for f in range(len(turns)):
        far, row = np.sqrt(np.square(turns[f]).sum()), by_turn[f]
        for i in range(n):
            reach[i] += row[i] * far
    return position, reach
