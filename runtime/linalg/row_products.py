"""Compiled kernels for positions and deformation gradients of many points from the handle rows.

They are three to six times as fast as matrix products, which are optimised for more columns than two or three.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import summing

Floats = NDArray[np.floating[Any]]


@summing
def _place(weights: Floats, x: Array, y: Array, z: Array, place: Array) -> None:
    """The position of one point, written into place (dim,); in 2D the second axis is written twice."""
    along_x = along_y = along_z = 0.0
    for r in range(len(weights)):
        along_x += x[r] * weights[r]
        along_y += y[r] * weights[r]
        along_z += z[r] * weights[r]
    place[0], place[1], place[len(place) - 1] = along_x, along_y, along_z


@summing(reference=lambda weights, rows, index: weights[index] @ rows)
def placed_some(weights: Floats, rows: Array, index: IntArray) -> Array:
    """U rows (m, dim) at some of n points (m,); weights: U (n, n_rows); rows (n_rows, dim)."""
    dim = rows.shape[1]
    axes, places = np.ascontiguousarray(rows.T), np.empty((len(index), dim))
    for k, i in enumerate(index):
        _place(weights[i], axes[0], axes[1], axes[dim - 1], places[k])
    return places


@summing(reference=lambda weights, rows: weights @ rows)
def placed(weights: Floats, rows: Array) -> Array:
    """`placed_some` at all points (n, dim)."""
    return placed_some(weights, rows, np.arange(len(weights)))


@summing(reference=lambda gradients, rows, index: np.einsum("njr,ra->naj", gradients[index], rows))
def deformed_some(gradients: Floats, rows: Array, index: IntArray) -> Array:
    """F = rows^T G (m, dim, dim) at some of n points (m,); gradients: G^T (n, dim, n_rows). Summed in double precision,
    so that rotating the rows rotates F up to round-off."""
    dim = rows.shape[1]
    axes, F, column = np.ascontiguousarray(rows.T), np.empty((len(index), dim, dim)), np.empty(dim)
    for k, i in enumerate(index):
        for j in range(dim):
            _place(gradients[i, j], axes[0], axes[1], axes[dim - 1], column)
            for a in range(dim):
                F[k, a, j] = column[a]
    return F


@summing(reference=lambda gradients, rows: np.einsum("njr,ra->naj", gradients, rows))
def deformed(gradients: Floats, rows: Array) -> Array:
    """`deformed_some` at all points (n, dim, dim)."""
    return deformed_some(gradients, rows, np.arange(len(gradients)))
