"""A partition of the body into regions with one rotation each, for sums over the body that are precomputed."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray, scatter_sum
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.cubature import elastic_cells
from softprint.runtime.body.farthest_points import farthest_points
from softprint.runtime.mechanics.corotation import Corotation
from softprint.runtime.mechanics.static_condensation import StaticCondensation

# Regions for each handle. More gain little: on the Hand, two make no difference.
_REGIONS = 1


class BodyRegions:
    """`count` regions. Every node and every cell of the body belongs to the region with the nearest centre."""

    def __init__(self, body: ReducedBody, condensation: StaticCondensation) -> None:
        """condensation: of all nodes of the body."""
        self._body, self._condensation = body, condensation
        handles, elastic = body.handles, elastic_cells(body.mesh, body.handles)
        n_handles = handles.n_points + len(handles.frames)
        wanted = 1 if condensation.corotation.uniform else _REGIONS * n_handles
        places = body.mesh.cell_centroids[elastic]
        self._centres = cKDTree(places[farthest_points(places, min(wanted, len(places)))])

    @property
    def count(self) -> int:
        return int(self._centres.n)

    def of(self, places: Array) -> IntArray:
        """(n,) the regions of rest positions (n, dim)."""
        return np.asarray(self._centres.query(places)[1], dtype=np.int64)

    @cached_property
    def of_nodes(self) -> IntArray:
        """(n_nodes,) the region of every node."""
        return self.of(self._body.mesh.points)

    @cached_property
    def corotation(self) -> Corotation:
        """The corotation of every region, from the mean of its nodes; from the mean of the body where it has none."""
        gradients = self._condensation.rotation_gradients.astype(np.float64)
        mesh = self._body.mesh
        corners = mesh.dim + 1
        share = scatter_sum(mesh.cells, np.repeat(mesh.cell_volumes / corners, corners), mesh.n_nodes)
        mean = np.tensordot(share, gradients, 1) / share.sum()
        total = np.zeros((self.count, *gradients.shape[1:]))
        np.add.at(total, self.of_nodes, share[:, None, None] * gradients)
        volume = scatter_sum(self.of_nodes, share, self.count)
        total[volume == 0.0], volume[volume == 0.0] = mean, 1.0
        return Corotation(total / volume[:, None, None], self._condensation.affine_part)
