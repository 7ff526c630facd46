"""Products with mostly zero directions T (n, k), such as the tangents of the handle coordinates: each of them changes
the rows of one handle only."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.compiled import summing

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]


@summing
def _along(matrix: Floats, T: Array) -> Floats:
    """T^T M (k, m) of M (n, m), whole rows at a time for vectorisation."""
    rows, columns = np.nonzero(T)
    result = np.zeros((T.shape[1], matrix.shape[1]), matrix.dtype)
    for at in range(len(rows)):
        share = matrix.dtype.type(T[rows[at], columns[at]])
        row, into = matrix[rows[at]], result[columns[at]]
        for column in range(len(row)):
            into[column] += share * row[column]
    return result


@summing(reference=lambda matrix, T: matrix @ T)
def times_directions(matrix: Floats, T: Array) -> Floats:
    """M T (m, k) of M (m, n), in its precision."""
    return np.ascontiguousarray(_along(np.ascontiguousarray(matrix.T), T).T)


@summing(reference=lambda matrix, T: T.T @ matrix @ T)
def between_directions(matrix: Array, T: Array) -> Array:
    """T^T M T (k, k) of M (n, n)."""
    return _along(np.ascontiguousarray(_along(matrix, T).T), T).T.copy()
