"""Points of the rigid frames of a body that can bear on a collider.

A frame is the nodes of its region, and with them every edge, facet and cell of the mesh between them. Its outside is
what belongs to a cell that can deform, or to the surface of the body. Points are spread over all of that, about as far
apart as is asked for: a bone of a few nodes is a chain of edges, and a thin wall would slip between the nodes alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.mesh.facet_lattice import edge_parts, lattice
from softprint.runtime.mesh.mesh import Mesh

# Points that are looked at together.
_TOGETHER = 64


@dataclass(frozen=True, eq=False)
class FramePoints:
    """n points of the frames of a body, in b balls of some tens of points that are near each other. rest: (n, dim+1)
    rest positions followed by ones; columns: (n, dim+1) the handle rows that place each, so that positions are sum_k
    rest_k rows[columns_k]; area: that each stands for [m^(dim-1)]; surface: (n,) the nearest node of the surface of
    each, its place among them; first: (b+1,) where the points of each ball begin; centres: (b, dim+1) of the balls,
    like rest, and radii: (b,) [m]."""

    rest: Array
    columns: IntArray
    area: float
    surface: IntArray
    first: IntArray
    centres: Array
    radii: Array

    @classmethod
    def of(cls, body: ReducedBody, spacing: float) -> FramePoints:
        """spacing: [m], the largest distance between points along an edge."""
        mesh, rest, rows, counts = body.mesh, [], [], []
        for frame in body.handles.frames:
            tree = cKDTree(outside_points(mesh, frame.nodes, spacing), leafsize=_TOGETHER)
            own = body.handles.rows_of(frame.name)
            rest.append(tree.data[tree.indices])
            rows.append(np.tile(np.arange(own.start, own.stop), (tree.n, 1)))
            counts.append(np.diff([*_leaves(tree.tree), tree.n]))
        every, sizes = np.concatenate(rest), np.concatenate(counts)
        first = np.concatenate([[0], np.cumsum(sizes)])
        centres = np.add.reduceat(every, first[:-1]) / sizes[:, None]
        away = np.linalg.norm(every - np.repeat(centres, sizes, axis=0), axis=1)
        return cls(
            _affine(every),
            np.concatenate(rows),
            spacing ** (mesh.dim - 1),
            cKDTree(mesh.points[mesh.surface_nodes]).query(every)[1],
            first,
            _affine(centres),
            np.maximum.reduceat(away, first[:-1]),
        )

    def near(self, rows: Array, collider: Collider, pose: RigidPose) -> IntArray:
        """Points (m,) of the balls that are not outside of the collider as a whole, at handle rows (n_rows, dim)."""
        centres = _placed(self.centres, self.columns[self.first[:-1]], rows)
        balls, _, distance = collider.closer_to(centres, pose, float(self.radii.max()))
        inside = balls[distance < self.radii[balls]]
        return np.concatenate(
            [np.arange(*self.first[k : k + 2]) for k in inside] or [np.empty(0, dtype=np.int64)]
        )

    def positions(self, rows: Array, index: IntArray) -> Array:
        """x (m, dim) [m] of some points (m,) at handle rows (n_rows, dim)."""
        return _placed(self.rest[index], self.columns[index], rows)

    def basis(self, index: IntArray, n_rows: int) -> Array:
        """(m, n_rows) of some points (m,)."""
        basis = np.zeros((len(index), n_rows))
        np.put_along_axis(basis, self.columns[index], self.rest[index], axis=1)
        return basis


def _placed(rest: Array, columns: IntArray, rows: Array) -> Array:
    return np.asarray(np.einsum("mk,mkd->md", rest, rows[columns]))


def _leaves(node: Any) -> list[int]:
    """Where the leaves of a k-d tree begin, ascending."""
    if node.lesser is None:
        return [node.start_idx]
    return _leaves(node.lesser) + _leaves(node.greater)


def _affine(points: Array) -> Array:
    return np.column_stack([points, np.ones(len(points))])


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
            for which in combinations(range(simplices.shape[1]), corners)
        ]
        rigid = np.concatenate(every)
        rigid = np.unique(np.sort(rigid[inside[rigid].all(axis=1)], axis=1), axis=0)
        found.append(_spread(mesh.points[rigid], spacing))
    return np.concatenate(found)


def _spread(simplices: Array, spacing: float) -> Array:
    """Points (k, dim) inside simplices with corners (m, c, dim), which divide their longest edges evenly."""
    c, dim = simplices.shape[1:]
    if c == 1:
        return simplices[:, 0]
    parts, found = edge_parts(simplices, spacing), [np.empty((0, dim))]
    for count in np.unique(parts):
        weights = lattice(count, c)
        inside = weights[weights.min(axis=1) > 0.0]
        found.append(np.einsum("kc,mcd->mkd", inside, simplices[parts == count]).reshape(-1, dim))
    return np.concatenate(found)
