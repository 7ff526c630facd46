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
def times_directions(matrix: Floats, T: Array) -> Floats:
    """M T (m, k) of M (m, n), in its precision."""
    rows, columns = np.nonzero(T)
    result = np.zeros((len(matrix), T.shape[1]), matrix.dtype)
    shares = np.empty(len(rows), matrix.dtype)
    for at in range(len(rows)):
        shares[at] = T[rows[at], columns[at]]
    for i in range(len(matrix)):
        row, into = matrix[i], result[i]
        for at in range(len(rows)):
            into[columns[at]] += row[rows[at]] * shares[at]
    return result


@summing
def between_directions(matrix: Array, T: Array) -> Array:
    """T^T M T (k, k) of M (n, n)."""
    n, k = T.shape
    half = np.zeros((k, n))
    rows, columns = np.nonzero(T)
    for at in range(len(rows)):
        share, row, into = T[rows[at], columns[at]], matrix[rows[at]], half[columns[at]]
        for column in range(n):
            into[column] += share * row[column]
    result = np.zeros((k, k))
    for i in range(k):
        row, into = half[i], result[i]
        for at in range(len(rows)):
            into[columns[at]] += row[rows[at]] * T[rows[at], columns[at]]
    return result
