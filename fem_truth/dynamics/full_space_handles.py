"""Handles in full space: the regions of frames, which are rigid, and what is kinematic, whose positions are prescribed.

A point is prescribed as its row in the reduced state of the body (`ReducedBody.project`), like a state of the truth. A
single fixed node would be a point load, whose displacement depends on the size of the cells.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.fem_truth.linalg.rigid_regions import RigidRegions
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody
from softprint.runtime.dynamics import KinematicHandle
from softprint.runtime.dynamics.kinematic import place_kinematic


class FullSpaceHandles:
    """Of every frame the region is rigid, as in the truth; with soft_frames only of those that are kinematic.

    rigid: the regions that move freely.
    """

    def __init__(
        self, body: ReducedBody, kinematic: Sequence[KinematicHandle], soft_frames: bool = False
    ) -> None:
        self._body, self._kinematic = body, tuple(kinematic)
        handles = body.handles
        self._points: IntArray = np.array(
            [held.handle for held in kinematic if not isinstance(held.handle, str)], dtype=np.int64
        )
        held_frames = {held.handle for held in kinematic}
        self._frames = [frame for frame in handles.frames if frame.name in held_frames]
        free = [frame.nodes for frame in handles.frames if frame.name not in held_frames]
        self.rigid = RigidRegions(body.mesh.points, [] if soft_frames else free)
        self._weights = np.zeros((0, body.n_nodes))
        if len(self._points):
            self._weights = body.point_projection[self._points]

    @property
    def null_space(self) -> NullSpace:
        """The displacements (n_nodes, dim) that leave all of these where they are."""
        nodes = [frame.nodes for frame in self._frames]
        fixed = np.unique(np.concatenate([*nodes, self.rigid.nodes])).astype(np.int64)
        return NullSpace(self._weights.T, fixed)

    def place(self, x: Array, at: float) -> Array:
        """x (n_nodes, dim) [m], changed so that these handles are at their positions at time ``at`` [s]: the nodes of
        frames alone, and for the points as the subspace moves with them; and so that other frames are rigid."""
        body, rest = self._body, self._body.rest_rows
        rows = place_kinematic(rest, rest, body.handles, self._kinematic, at)
        x = self.rigid.place(x).copy()
        for frame in self._frames:
            block = rows[body.handles.rows_of(frame.name)]
            x[frame.nodes] = body.mesh.points[frame.nodes] @ block[:-1] + block[-1]
        if len(self._points):
            x += body.basis[:, self._points] @ (rows[self._points] - self._weights @ x)
        return x

    def moved(self, x: Array, step: Array) -> Array:
        """x + step (n_nodes, dim) with the regions that move freely turned, and the points where the step says."""
        reached = self.rigid.moved(x, step)
        if len(self._points) and len(self.rigid):
            reached += self._body.basis[:, self._points] @ (self._weights @ (x + step - reached))
        return reached

    def null_space_at(self, null_space: NullSpace, x: Array, forces: Array | None, convex: bool) -> NullSpace:
        """`null_space`, with the twists at x of the regions that move freely; see `RigidRegions.tangent`."""
        return null_space.with_rigid(self.rigid.tangent(x, forces, convex)) if len(self.rigid) else null_space
