"""Normals of a surface that are smooth except at true edges, as a graphics card takes them: one for each corner, which
is a vertex on one side of an edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.mesh.mesh import facet_vectors

_EDGE_ANGLE = 50.0  # between two facets [degrees] from which the edge between them is sharp


@dataclass(frozen=True, eq=False)
class Shading:
    """vertex: (k,) of each corner; triangles: (t, 3) by their corners."""

    vertex: IntArray
    triangles: IntArray
    _around: sp.csr_matrix  # (k, t): the triangles of each corner
    _by_vertex: IntArray  # (t, 3)

    @classmethod
    def of(cls, points: Array, triangles: IntArray) -> Shading:
        """Of a surface (s, 3) with triangles (t, 3), at rest: the corners stay the same when it deforms."""
        count = len(triangles)
        smooth = connected_components(_smooth_neighbours(points, triangles), directed=False)[1]
        keys = triangles.astype(np.int64) * (int(smooth.max(initial=0)) + 1) + smooth[:, None]
        unique, corner = np.unique(keys, return_inverse=True)
        corners = corner.reshape(-1, 3)
        vertex = np.empty(len(unique), dtype=np.int64)
        vertex[corners] = triangles
        entries = corners.ravel(), np.repeat(np.arange(count), 3)
        around = sp.csr_matrix((np.ones(3 * count), entries), (len(unique), count))
        return cls(vertex, corners, around, triangles)

    def normals(self, points: Array) -> Array:
        """(k, 3) unit normals at the corners of the surface at points (s, 3), averaged by area."""
        sums = self._around @ facet_vectors(points, self._by_vertex)
        length = np.linalg.norm(sums, axis=1, keepdims=True)
        return np.where(length > 0, sums / np.maximum(length, np.finfo(float).tiny), [0.0, 0.0, 1.0])


def _smooth_neighbours(points: Array, triangles: IntArray) -> sp.coo_matrix:
    """(t, t): pairs of triangles with a smooth edge between them."""
    count = len(triangles)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    edges, owner = edges[order], np.repeat(np.arange(count), 3)[order]
    shared = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    one, other = owner[shared], owner[shared + 1]
    normals = facet_vectors(points, triangles)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    smooth = (normals[one] * normals[other]).sum(axis=1) > np.cos(np.radians(_EDGE_ANGLE))
    one, other = one[smooth], other[smooth]
    return sp.coo_matrix((np.ones(len(one)), (one, other)), (count, count))
