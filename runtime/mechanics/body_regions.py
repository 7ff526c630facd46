"""A body in parts that each turn by one rotation: for what is summed over the body ahead of time."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from runtime.arrays import Array, IntArray, scatter_sum
from runtime.body.body import ReducedBody
from runtime.body.cubature import elastic_cells
from runtime.body.farthest_points import farthest_points
from runtime.mechanics.corotation import Corotation
from runtime.mechanics.static_condensation import StaticCondensation

# Regions for each handle. More of them gain little: on the Hand, two make no difference.
_REGIONS = 1


class BodyRegions:
    """Every node and every cell of the body is of the region whose centre is nearest, of `count`."""

    def __init__(self, body: ReducedBody, internal: StaticCondensation) -> None:
        """internal: of all nodes of the body."""
        self._body, self._internal = body, internal
        handles, elastic = body.handles, elastic_cells(body.mesh, body.handles)
        n_handles = handles.n_points + len(handles.frames)
        wanted = 1 if internal.turns_as_one else _REGIONS * n_handles
        places = body.mesh.cell_centroids[elastic]
        self._centres = cKDTree(places[farthest_points(places, min(wanted, len(places)))])

    @property
    def count(self) -> int:
        return int(self._centres.n)

    def of(self, places: Array) -> IntArray:
        """(n,) regions of places (n, dim) at rest."""
        return np.asarray(self._centres.query(places)[1], dtype=np.int64)

    @cached_property
    def of_nodes(self) -> IntArray:
        """(n_nodes,)"""
        return self.of(self._body.mesh.points)

    @cached_property
    def turning(self) -> Corotation:
        """By the mean of the nodes in a region; the body's own where there is none."""
        turning = self._internal.turning.astype(np.float64)
        mesh = self._body.mesh
        corners = mesh.dim + 1
        share = scatter_sum(mesh.cells, np.repeat(mesh.cell_volumes / corners, corners), mesh.n_nodes)
        mean = np.tensordot(share, turning, 1) / share.sum()
        total = np.zeros((self.count, *turning.shape[1:]))
        np.add.at(total, self.of_nodes, share[:, None, None] * turning)
        volume = scatter_sum(self.of_nodes, share, self.count)
        total[volume == 0.0], volume[volume == 0.0] = mean, 1.0
        return Corotation(total / volume[:, None, None], self._internal.positions)
