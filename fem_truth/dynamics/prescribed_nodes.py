"""The nodes of kinematic handles, whose positions are prescribed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody
from softprint.runtime.dynamics import KinematicHandle
from softprint.runtime.dynamics.kinematic import place_kinematic


class PrescribedNodes:
    """index: (k,) of these nodes. The region of a frame moves rigidly."""

    def __init__(self, body: ReducedBody, kinematic: Sequence[KinematicHandle]) -> None:
        self._body, self._kinematic = body, tuple(kinematic)
        nodes = [self._nodes(held) for held in self._kinematic]
        self.index: IntArray = np.unique(np.concatenate([*nodes, np.empty(0, dtype=np.int64)])).astype(
            np.int64
        )

    def place(self, x: Array, at: float) -> Array:
        """A copy of x (n_nodes, dim) [m] with these nodes at their positions at time ``at`` [s]."""
        rest, handles = self._body.rest_rows, self._body.handles
        rows = place_kinematic(rest, rest, handles, self._kinematic, at)
        x = x.copy()
        for held in self._kinematic:
            block, nodes = rows[handles.rows_of(held.handle)], self._nodes(held)
            if isinstance(held.handle, str):
                x[nodes] = self._body.mesh.points[nodes] @ block[:-1] + block[-1]
            else:
                x[nodes] = block[0]
        return x

    def _nodes(self, held: KinematicHandle) -> IntArray:
        """Those of one handle."""
        handles = self._body.handles
        if isinstance(held.handle, str):
            return next(frame for frame in handles.frames if frame.name == held.handle).nodes
        return handles.points[[held.handle]]
