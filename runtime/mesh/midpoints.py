"""The midpoint rule on facets: exact for what is constant over a facet, and seeing what is as large as its parts."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array


def midpoints(parts: int, dim: int) -> Array:
    """Barycentric coordinates (parts^(dim-1), dim) of the centres of equal parts of an edge or a triangle."""
    if dim == 2:
        along = (np.arange(parts) + 0.5) / parts
        return np.column_stack([1.0 - along, along])
    i, j = np.meshgrid(np.arange(parts), np.arange(parts), indexing="ij")
    upright, inverted = i + j < parts, i + j < parts - 1
    a = np.concatenate([i[upright] + 1 / 3, i[inverted] + 2 / 3]) / parts
    b = np.concatenate([j[upright] + 1 / 3, j[inverted] + 2 / 3]) / parts
    return np.column_stack([1.0 - a - b, a, b])
