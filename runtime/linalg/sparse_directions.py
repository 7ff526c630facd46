"""Products with directions T (n, k) most of whose entries are zero, as those of the coordinates of points and frames by
the handle rows: each of them moves the rows of one handle."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.compiled import summing

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]


@summing
def _along(matrix: Floats, T: Array) -> Floats:
    """T^T M (k, m) of M (n, m): whole rows at once, which the processor takes several entries of."""
    rows, columns = np.nonzero(T)
    result = np.zeros((T.shape[1], matrix.shape[1]), matrix.dtype)
    for at in range(len(rows)):
        share = matrix.dtype.type(T[rows[at], columns[at]])
        row, into = matrix[rows[at]], result[columns[at]]
        for column in range(len(row)):
            into[column] += share * row[column]
    return result


@summing
def times_directions(matrix: Floats, T: Array) -> Floats:
    """M T (m, k) of M (m, n), in its precision."""
    return np.ascontiguousarray(_along(np.ascontiguousarray(matrix.T), T).T)


@summing
def between_directions(matrix: Array, T: Array) -> Array:
    """T^T M T (k, k) of M (n, n)."""
    return _along(np.ascontiguousarray(_along(matrix, T).T), T).T.copy()
