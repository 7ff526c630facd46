"""Points of the rigid frames of a body that can bear on a collider.

A frame is the nodes of its region, and with them every edge, facet and cell of the mesh between them. Its outside is
what belongs to a cell that can deform, or to the surface of the body. Points are spread over all of that, about as far
apart as is asked for: a bone of a few nodes is a chain of edges, and a thin wall would slip between the nodes alone.
Together they stand for the area of the frame's facets, so that a frame bears as much as in the truth. Points of edges
and nodes that are part of no facet stand for a square of the spacing each.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, BoolArray, IntArray, scatter_sum
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.piercing_kernels import in_box
from softprint.runtime.mesh.facet_lattice import edge_parts, lattice
from softprint.runtime.mesh.mesh import Mesh, facet_vectors
from softprint.runtime.mesh.midpoints import midpoints

# Points that are looked at together.
_TOGETHER = 64
# A smoothed distance is negative up to so much of the size of a collider outside its bounds, at most.
_BEYOND = 0.1
# The area of a facet is given to the points nearest to so many parts of it along an edge.
_PARTS = 4


@dataclass(frozen=True, eq=False)
class FramePoints:
    """n points of the frames of a body, in b balls of some tens of points that are near each other. rest: (n, dim+1)
    rest positions followed by ones; columns: (n, dim+1) the handle rows that place each, so that positions are sum_k
    rest_k rows[columns_k]; areas: (n,) that they stand for [m^(dim-1)]; surface: (n,) the nearest node of the surface
    of each, its place among them; first: (b+1,) where the points of each ball begin; centres: (b, dim+1) of the balls,
    like rest, and radii: (b,) [m]."""

    rest: Array
    columns: IntArray
    areas: Array
    surface: IntArray
    first: IntArray
    centres: Array
    radii: Array

    @classmethod
    def of(cls, body: ReducedBody, spacing: float) -> FramePoints:
        """spacing: [m], the largest distance between points along an edge."""
        mesh, rest, areas, rows, counts = body.mesh, [], [], [], []
        for frame in body.handles.frames:
            points, area = outside_points(mesh, frame.nodes, spacing)
            tree = cKDTree(points, leafsize=_TOGETHER)
            own = body.handles.rows_of(frame.name)
            rest.append(points[tree.indices])
            areas.append(area[tree.indices])
            rows.append(np.tile(np.arange(own.start, own.stop), (tree.n, 1)))
            counts.append(np.diff([*_leaves(tree.tree), tree.n]))
        every, sizes = np.concatenate(rest), np.concatenate(counts)
        first = np.concatenate([[0], np.cumsum(sizes)])
        centres = np.add.reduceat(every, first[:-1]) / sizes[:, None]
        away = np.linalg.norm(every - np.repeat(centres, sizes, axis=0), axis=1)
        return cls(
            _affine(every),
            np.concatenate(rows),
            np.concatenate(areas),
            cKDTree(mesh.points[mesh.surface_nodes]).query(every)[1],
            first,
            _affine(centres),
            np.maximum.reduceat(away, first[:-1]),
        )

    def near(self, rows: Array, collider: Collider, pose: RigidPose) -> IntArray:
        """Points (m,) of the balls that are not outside of the collider as a whole, at handle rows (n_rows, dim)."""
        centres = _placed(self.centres, self.columns[self.first[:-1]], rows)
        reach = float(self.radii.max()) + _BEYOND * collider.size
        if not len(in_box(pose.apply_inverse(centres), collider.lower - reach, collider.upper + reach)):
            return np.empty(0, dtype=np.int64)
        balls, _, distance = collider.closer_to(centres, pose, float(self.radii.max()))
        inside = balls[distance < self.radii[balls]]
        return np.concatenate(
            [np.arange(*self.first[k : k + 2]) for k in inside] or [np.empty(0, dtype=np.int64)]
        )

    def positions(self, rows: Array, index: IntArray) -> Array:
        """x (m, dim) [m] of some points (m,) at handle rows (n_rows, dim)."""
        return _placed(self.rest[index], self.columns[index], rows)

    def any_inside(self, rows: Array, collider: Collider, pose: RigidPose) -> bool:
        """Whether a collider presses a frame at handle rows (n_rows, dim)."""
        x = self.positions(rows, self.near(rows, collider, pose))
        return bool((collider.sdf(pose.apply_inverse(x)) < 0.0).any())

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


def outside_points(mesh: Mesh, nodes: IntArray, spacing: float) -> tuple[Array, Array]:
    """Points (n, dim) [m] on the outside of the rigid region of some nodes, these among them, and the areas (n,) that
    they stand for [m^(dim-1)]."""
    facets, found, stand_for = _outside(mesh, nodes, mesh.dim), [], []
    for corners in range(1, mesh.dim + 1):
        simplices = _outside(mesh, nodes, corners)
        of_facets = _are_parts(simplices, facets)
        for some, area in ((simplices[of_facets], 0.0), (simplices[~of_facets], spacing ** (mesh.dim - 1))):
            found.append(_spread(mesh.points[some], spacing))
            stand_for.append(np.full(len(found[-1]), area))
    points, areas = np.concatenate(found), np.concatenate(stand_for)
    if len(facets):
        weights = midpoints(_PARTS, mesh.dim)
        parts = np.einsum("kc,mcd->mkd", weights, mesh.points[facets]).reshape(-1, mesh.dim)
        size = np.linalg.norm(facet_vectors(mesh.points, facets), axis=1) / len(weights)
        nearest = cKDTree(points).query(parts)[1]
        areas += scatter_sum(nearest, size.repeat(len(weights)), len(points))
    return points, areas


def _outside(mesh: Mesh, nodes: IntArray, corners: int) -> IntArray:
    """The nodes, edges or facets (m, corners), by the number of their corners, on the outside of a rigid region."""
    inside = np.zeros(mesh.n_nodes, dtype=bool)
    inside[nodes] = True
    cells = mesh.cells[~inside[mesh.cells].all(axis=1)]
    every = [
        simplices[:, list(which)]
        for simplices in (cells, mesh.facets)
        for which in combinations(range(simplices.shape[1]), corners)
    ]
    rigid = np.concatenate(every)
    return np.unique(np.sort(rigid[inside[rigid].all(axis=1)], axis=1), axis=0)


def _are_parts(simplices: IntArray, facets: IntArray) -> BoolArray:
    """Which of simplices (m, c), with ascending corners, are parts of facets (f, dim), alike."""
    c = simplices.shape[1]
    parts = {
        tuple(facet[list(which)]) for facet in facets for which in combinations(range(facets.shape[1]), c)
    }
    return np.array([tuple(simplex) in parts for simplex in simplices], dtype=bool)


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
