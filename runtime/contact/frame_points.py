"""Points of the rigid frames of a body that can bear on a collider.

A frame is the nodes of its region, and with them every edge, facet and cell of the mesh between them. Its outside is
what belongs to a cell that can deform, or to the surface of the body. Points are spread over all of that, about as far
apart as is asked for: a bone of a few nodes is a chain of edges, and a thin wall would slip between the nodes alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.handles import FrameHandle
from softprint.runtime.mesh.facet_lattice import lattice
from softprint.runtime.mesh.mesh import Mesh

# Parts of an edge at most.
_MOST_PARTS = 16


@dataclass(frozen=True, eq=False)
class FramePoints:
    """n points of one frame. rows: its handle rows; rest: (n, dim+1) rest positions followed by ones, so that positions
    are rest @ rows; area: that each stands for [m^(dim-1)]; surface: (n,) the nearest node of the surface of each, its
    place among them; radius: of the ball about the pivot that has all points [m]."""

    rows: slice
    pivot: Array
    rest: Array
    area: float
    surface: IntArray
    radius: float

    @classmethod
    def of(cls, body: ReducedBody, frame: FrameHandle, spacing: float) -> FramePoints:
        """spacing: [m], the largest distance between points along an edge."""
        mesh = body.mesh
        rest = outside_points(mesh, frame.nodes, spacing)
        surface = cKDTree(mesh.points[mesh.surface_nodes]).query(rest)[1]
        radius = float(np.linalg.norm(rest - frame.pivot, axis=1).max())
        at_rest = np.column_stack([rest, np.ones(len(rest))])
        area = spacing ** (mesh.dim - 1)
        return cls(body.handles.rows_of(frame.name), frame.pivot, at_rest, area, surface, radius)

    def centre(self, rows: Array) -> Array:
        """(dim,) [m] of the pivot at handle rows (n_rows, dim)."""
        return np.asarray(np.append(self.pivot, 1.0) @ rows[self.rows])

    def positions(self, rows: Array) -> Array:
        """(n, dim) [m] at handle rows (n_rows, dim)."""
        return np.asarray(self.rest @ rows[self.rows])


def outside_points(mesh: Mesh, nodes: IntArray, spacing: float) -> Array:
    """(n, dim) [m] on the outside of the rigid region of some nodes, these among them."""
    inside = np.zeros(mesh.n_nodes, dtype=bool)
    inside[nodes] = True
    cells = mesh.cells[~inside[mesh.cells].all(axis=1)]
    found = []
    for corners in range(1, mesh.dim + 1):
        every = [
            simplices[:, list(which)]
            for simplices in (cells, mesh.facets)
            for which in _faces(simplices, corners)
        ]
        rigid = np.concatenate(every)
        rigid = np.unique(np.sort(rigid[inside[rigid].all(axis=1)], axis=1), axis=0)
        found.append(_spread(mesh.points[rigid], spacing))
    return np.concatenate(found)


def _faces(simplices: IntArray, corners: int) -> combinations[tuple[int, ...]]:
    """Which corners of simplices (m, c) their faces with so many corners have."""
    return combinations(range(simplices.shape[1]), corners)


def _spread(simplices: Array, spacing: float) -> Array:
    """Points (k, dim) inside simplices with corners (m, c, dim), which divide their longest edges evenly."""
    c, dim = simplices.shape[1:]
    if c == 1:
        return simplices[:, 0]
    edges = np.stack([simplices[:, a] - simplices[:, b] for a, b in combinations(range(c), 2)], axis=1)
    longest = np.linalg.norm(edges, axis=2).max(axis=1, initial=0.0)
    parts = np.clip(np.ceil(longest / spacing), 1, _MOST_PARTS).astype(int)
    found = [np.empty((0, dim))]
    for count in np.unique(parts):
        weights = lattice(count, c)
        inside = weights[weights.min(axis=1) > 0.0]
        found.append(np.einsum("kc,mcd->mkd", inside, simplices[parts == count]).reshape(-1, dim))
    return np.concatenate(found)
