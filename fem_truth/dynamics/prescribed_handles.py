"""Kinematic handles in full space: the nodes of frames and the projections of points, whose positions are prescribed.

A point is prescribed as its row in the reduced state of the body (`ReducedBody.project`), like a state of the truth. A
single fixed node would be a point load, whose displacement depends on the size of the cells.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody
from softprint.runtime.dynamics import KinematicHandle
from softprint.runtime.dynamics.kinematic import place_kinematic


class PrescribedHandles:
    """The region of a frame moves rigidly."""

    def __init__(self, body: ReducedBody, kinematic: Sequence[KinematicHandle]) -> None:
        self._body, self._kinematic = body, tuple(kinematic)
        handles = body.handles
        self._points: IntArray = np.array(
            [held.handle for held in kinematic if not isinstance(held.handle, str)], dtype=np.int64
        )
        self._frames = [
            frame for frame in handles.frames if frame.name in {held.handle for held in kinematic}
        ]
        self._weights = np.zeros((0, body.n_nodes))
        if len(self._points):
            self._weights = body.point_projection[self._points]

    @property
    def null_space(self) -> NullSpace:
        """The displacements (n_nodes, dim) that leave them where they are."""
        nodes = [frame.nodes for frame in self._frames]
        fixed = np.unique(np.concatenate([*nodes, np.empty(0, dtype=np.int64)])).astype(np.int64)
        return NullSpace(self._weights.T, fixed)

    def place(self, x: Array, at: float) -> Array:
        """x (n_nodes, dim) [m], changed so that these handles are at their positions at time ``at`` [s]: the nodes of
        frames alone, and for the points as the subspace moves with them."""
        body, rest = self._body, self._body.rest_rows
        rows = place_kinematic(rest, rest, body.handles, self._kinematic, at)
        x = x.copy()
        for frame in self._frames:
            block = rows[body.handles.rows_of(frame.name)]
            x[frame.nodes] = body.mesh.points[frame.nodes] @ block[:-1] + block[-1]
        if len(self._points):
            x += body.basis[:, self._points] @ (rows[self._points] - self._weights @ x)
        return x
