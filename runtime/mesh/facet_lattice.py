"""Points spread over facets, as close together as is asked for."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from softprint.runtime.arrays import Array, IntArray

# Parts of an edge at most: a facet then has some hundred points.
_MOST_PARTS = 16


def facet_lattice(points: Array, facets: IntArray, spacing: float) -> Array:
    """Points (k, dim) [m] on facets (m, dim) of nodes (n, dim), at most about `spacing` [m] apart, on a regular lattice
    of each facet; without its corners."""
    corners = points[facets]
    parts = edge_parts(corners, spacing)
    found = [
        np.einsum("kc,mcd->mkd", lattice(count, points.shape[1]), corners[parts == count]).reshape(
            -1, points.shape[1]
        )
        for count in np.unique(parts)
    ]
    return np.vstack(found) if found else np.empty((0, points.shape[1]))


def edge_parts(simplices: Array, spacing: float) -> IntArray:
    """(m,) parts of at most `spacing` [m] that the longest edges of simplices with corners (m, c, dim) are divided
    into."""
    pairs = combinations(range(simplices.shape[1]), 2)
    edges = np.stack([simplices[:, a] - simplices[:, b] for a, b in pairs], axis=1)
    longest = np.linalg.norm(edges, axis=2).max(axis=1, initial=0.0)
    return np.clip(np.ceil(longest / spacing), 1, _MOST_PARTS).astype(int)


def lattice(parts: int, dim: int) -> Array:
    """Barycentric coordinates (k, dim) of the points that divide an edge, or the edges of a triangle and its inside,
    into equal parts; without the corners."""
    if dim == 2:
        along = np.arange(1, parts) / parts
        return np.column_stack([1.0 - along, along])
    i, j = np.meshgrid(np.arange(parts + 1), np.arange(parts + 1), indexing="ij")
    k = parts - i - j
    inside = (k >= 0) & (np.maximum(np.maximum(i, j), k) < parts)
    return np.column_stack([i[inside], j[inside], k[inside]]) / parts
