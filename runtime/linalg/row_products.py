"""Positions and deformation gradients of many points by the handle rows, compiled.

A product of matrices does the same, but is made for more columns than the axes of space: it takes three to six times as
long.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, IntArray
from runtime.compiled import summing

Floats = NDArray[np.floating[Any]]


@summing
def _place(weights: Floats, x: Array, y: Array, z: Array, place: Array) -> None:
    """place (dim,) of one point; in 2D the second axis is taken twice."""
    along_x = along_y = along_z = 0.0
    for r in range(len(weights)):
        along_x += x[r] * weights[r]
        along_y += y[r] * weights[r]
        along_z += z[r] * weights[r]
    place[0], place[1], place[len(place) - 1] = along_x, along_y, along_z


@summing
def placed_some(weights: Floats, rows: Array, index: IntArray) -> Array:
    """U rows (m, dim) at some points (m,), of U (n, n_rows) and rows (n_rows, dim)."""
    dim = rows.shape[1]
    axes, places = np.ascontiguousarray(rows.T), np.empty((len(index), dim))
    for k, i in enumerate(index):
        _place(weights[i], axes[0], axes[1], axes[dim - 1], places[k])
    return places


@summing
def placed(weights: Floats, rows: Array) -> Array:
    """The same at all points (n, dim)."""
    return placed_some(weights, rows, np.arange(len(weights)))


@summing
def deformed_some(gradients: Floats, rows: Array, index: IntArray) -> Array:
    """F = rows^T G (m, dim, dim) at some points (m,), of G^T (n, dim, n_rows); summed in double precision, so that
    turning the rows turns F to round-off."""
    dim = rows.shape[1]
    axes, F, column = np.ascontiguousarray(rows.T), np.empty((len(index), dim, dim)), np.empty(dim)
    for k, i in enumerate(index):
        for j in range(dim):
            _place(gradients[i, j], axes[0], axes[1], axes[dim - 1], column)
            for a in range(dim):
                F[k, a, j] = column[a]
    return F


@summing
def deformed(gradients: Floats, rows: Array) -> Array:
    """The same at all points (n, dim, dim)."""
    return deformed_some(gradients, rows, np.arange(len(gradients)))
