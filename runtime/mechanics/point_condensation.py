"""Static condensation at points that are weighted means of nodes: the nodes themselves, or points on facets.

Means of the displacements of nodes keep points on their deformed facets, whatever the rotations of the nodes. What is
evaluated for all points, the bounds on their positions, costs hardly more than for the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.linalg.means import bounded_means, means, numbered
from softprint.runtime.mechanics.position_bounds import BoundedPositions, PositionBounds
from softprint.runtime.mechanics.static_condensation import CorotatedCondensation, StaticCondensation


class CornerBounds(NamedTuple):
    """Bounds on the positions of the nodes at the corners of n points. nodes: (j,) these; corners: (n, c) their
    places among these."""

    nodes: IntArray
    corners: IntArray
    of_nodes: PositionBounds


@dataclass(frozen=True, eq=False)
class PointCondensation:
    """The static condensation u of n points. of_nodes: of k nodes; corners: (n, c) the nodes that each point is the
    mean of, with weights (n, c); bounds: on the positions of the points, None for points without."""

    of_nodes: StaticCondensation
    corners: IntArray
    weights: Array
    bounds: CornerBounds | None

    @classmethod
    def at(
        cls,
        body: ReducedBody,
        condensation: StaticCondensation,
        corners: IntArray,
        weights: Array,
        nodes: IntArray | None = None,
    ) -> PointCondensation:
        """At means of the nodes of a body: corners, weights (n, c). condensation: of all its nodes; nodes: (k,) those
        of `of_nodes`, ascending, by default the corners."""
        nodes = np.unique(corners) if nodes is None else nodes
        own = np.searchsorted(nodes, corners)
        used, places = numbered(own, len(nodes))
        bounds = PositionBounds(body.basis[nodes[used]], condensation.at(nodes[used]), body.handles)
        return cls(condensation.at(nodes), own, weights, CornerBounds(used, places, bounds))

    def corotated(self, frame_rows: Array) -> CorotatedPointCondensation:
        """u as an affine function of the handle rows, with the rotations of frame rows (n_rows, dim)."""
        return CorotatedPointCondensation(self, self.of_nodes.corotated(frame_rows))


@dataclass(frozen=True, eq=False)
class CorotatedPointCondensation:
    """u of n points in the corotated frame of a step. of_nodes: of their nodes."""

    condensation: PointCondensation
    of_nodes: CorotatedCondensation

    def displacement(self, rows: Array, index: IntArray | None = None) -> Array:
        """u (m, dim) [m] of some of the points (all by default) at handle rows (n_rows, dim), world frame."""
        if index is None:
            own = self.condensation
            return means(self.of_nodes.displacement(rows), own.corners, own.weights)
        nodes, corners = self._nodes(index)
        return means(self.of_nodes.displacement(rows, nodes), corners, self.condensation.weights[index])

    def jacobian(self, index: IntArray) -> Array:
        """du_a/drows_rb (m, dim, n_rows, dim) of some of the points, world frame."""
        nodes, corners = self._nodes(index)
        return means(self.of_nodes.jacobian(nodes), corners, self.condensation.weights[index])

    def pulled_back(self, forces: Array, index: IntArray) -> Array:
        """sum_k f_k . du_k/drows (n_rows, dim) [N] of forces f (m, dim) [N] on some of the points, world frame."""
        corners, weights = self.condensation.corners[index], self.condensation.weights[index]
        on_corners = (weights[..., None] * forces[:, None]).reshape(-1, forces.shape[1])
        return self.of_nodes.pulled_back(on_corners, corners.ravel())

    def bounded(self, frame_rows: Array) -> BoundedPoints:
        """Bounds on the positions of the points, if they have them, in a step that starts at frame rows (n_rows,
        dim)."""
        own = self.condensation.bounds
        assert own is not None  # called for points on facets only
        about = own.of_nodes.about(frame_rows, self.of_nodes.displacement(frame_rows, own.nodes))
        return BoundedPoints(about, own.corners, self.condensation.weights)

    def _nodes(self, index: IntArray) -> tuple[IntArray, IntArray]:
        """The nodes (k,) at the corners of some of the points (m,), and these corners (m, c) by their places there."""
        return numbered(self.condensation.corners[index], len(self.of_nodes.rotations))


@dataclass(frozen=True, eq=False)
class BoundedPoints:
    """The means of the bounds of the nodes at the corners (n, c) of each point, with weights (n, c)."""

    of_nodes: BoundedPositions
    corners: IntArray
    weights: Array

    def __call__(self, rows: Array) -> tuple[Array, Array]:
        """Approximate positions (n, dim) [m] and the bounds on their error (n,) [m]."""
        return bounded_means(*self.of_nodes(rows), self.corners, self.weights)
