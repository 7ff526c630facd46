"""The signed distance of a closed triangle surface: exact at points, and by a fast sweep on a grid.

A bounding-box tree only finds the nearest facet fast where one facet is much nearer than the others: far from a surface
of many facets it tests thousands for each point. On a grid, the tree is therefore only queried for the nodes next to
the surface. The other nodes start from the nearest facets of their neighbours and walk over the surface from there
(`sweep_kernels.py`). This finds the nearest facet, except where several parts of the surface are nearly equally near
and no neighbour has found the nearest one; the error is then a fraction of a cell.
"""

from __future__ import annotations

import igl
import numpy as np
from scipy import sparse

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.surface_mesh import sweep_kernels

# Vertices of more facets than this (the tip of a fan) do not connect facets for the walk; edges still do.
_MOST_AROUND = 64
# Winding numbers are computed at this many points at a time, or at so many for each triangle if that is more.
_PART, _PART_OF_TRIANGLES = 100_000, 10


class MeshDistance:
    """The distance to the surface with vertices (v, 3) [m] and triangles (t, 3), closed and facing outward."""

    def __init__(self, vertices: Array, triangles: IntArray) -> None:
        self._vertices, self._triangles = vertices, triangles
        # Scaled to size one for libigl, which squares lengths and has absolute thresholds.
        self._origin, self._unit = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
        self._in_units = (vertices - self._origin) / self._unit

    def __call__(self, points: Array) -> Array:
        """(n,) [m] at points (n, 3), signed by pseudonormals (Baerentzen and Aanaes 2005)."""
        scaled = np.ascontiguousarray((points - self._origin) / self._unit)
        method = igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
        found = igl.signed_distance(scaled, self._in_units, self._triangles, sign_type=method)[0]
        return self._unit * np.asarray(found).reshape(-1)

    def on_grid(self, origin: Array, counts: IntArray, spacing: float) -> Array:
        """(n_0, n_1, n_2) [m] at the nodes origin + index spacing, signed by winding numbers (Barill et al. 2018)."""
        shape = np.asarray(counts, dtype=np.int64)
        vertices = (self._vertices - origin) / spacing
        corners = np.ascontiguousarray(vertices[self._triangles])
        nodes = np.stack(np.meshgrid(*(np.arange(float(n)) for n in shape), indexing="ij"), axis=-1).reshape(
            -1, 3
        )
        near = np.zeros(len(nodes), dtype=np.bool_)
        sweep_kernels.mark_near(corners, shape, near)
        squared, facet = np.full(len(nodes), np.inf), np.full(len(nodes), -1, dtype=np.int64)
        found = igl.point_mesh_squared_distance(nodes[near], vertices, self._triangles)
        squared[near], facet[near] = found[0], found[1]
        sweep_kernels.sweep(corners, *_neighbours(self._triangles), shape, near, squared, facet)
        winding = _winding_numbers(vertices, self._triangles, nodes)
        return np.where(winding > 0.5, -spacing, spacing).reshape(shape) * np.sqrt(squared).reshape(shape)


def _winding_numbers(vertices: Array, triangles: IntArray, points: Array) -> Array:
    """(n,) at points (n, 3), in parts: libigl lets no other thread run, such as that of a progress bar, until it
    returns. Each part builds a tree of the triangles."""
    n_parts = max(1, len(points) // max(_PART, _PART_OF_TRIANGLES * len(triangles)))
    parts = np.array_split(points, n_parts)
    return np.concatenate([np.asarray(igl.fast_winding_number(vertices, triangles, part)) for part in parts])


def _neighbours(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """The facets that share a corner with facet i are around[starts[i] : starts[i + 1]]."""
    facet, corner = np.repeat(np.arange(len(triangles)), 3), triangles.ravel()
    few = np.bincount(corner)[corner] <= _MOST_AROUND
    touches = sparse.csr_matrix(
        (np.ones(few.sum()), (facet[few], corner[few])), (len(triangles), corner.max() + 1)
    )
    sharing = (touches @ touches.T).tocsr()
    return sharing.indices.astype(np.int64), sharing.indptr.astype(np.int64)
