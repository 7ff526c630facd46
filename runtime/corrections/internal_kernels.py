"""The internal response of some nodes (m,), read where it lies: modes L (n, dim, n_rows, dim), weight w (n, dim,
dim)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, IntArray
from runtime.compiled import summing

Floats = NDArray[np.floating[Any]]


@summing
def displacement(
    modes: Floats, weight: Floats, index: IntArray, strain: Floats, hanging: Floats, turn: Array
) -> Array:
    """R (L d + w R^T g) (m, dim) for strain d (n_rows*dim,), hanging = R^T g (dim,) and turn R."""
    dim, size = len(turn), len(strain)
    u = np.zeros((len(index), dim))
    for k in range(len(index)):
        node = modes[index[k]].reshape(dim, size)
        for b in range(dim):
            turned = strain[0] * node[b, 0]
            for column in range(1, size):
                turned += node[b, column] * strain[column]
            for c in range(dim):
                turned += weight[index[k], b, c] * hanging[c]
            for a in range(dim):
                u[k, a] += turn[a, b] * turned
    return u


@summing
def derivative(modes: Floats, index: IntArray, mean: Array, positions: Array, turn: Array) -> Array:
    """R (L - (L mean) (x) positions) R^T (m, dim, n_rows, dim) [a, r, b]: du_a/drows_rb with the turn R held. mean
    (n_rows,): weights of the rows' mean translation, which strains nothing; positions (n_rows,): what it moves."""
    dim, n_rows = len(turn), len(mean)
    result = np.empty((len(index), dim, n_rows, dim))
    strained, right = np.empty((dim, n_rows, dim)), np.empty((dim, dim))
    for k in range(len(index)):
        strained[:] = modes[index[k]]
        for a in range(dim):
            for b in range(dim):
                drift = 0.0
                for r in range(n_rows):
                    drift += strained[a, r, b] * mean[r]
                for r in range(n_rows):
                    strained[a, r, b] -= drift * positions[r]
        for r in range(n_rows):
            for a in range(dim):
                for b in range(dim):
                    right[a, b] = 0.0
                    for c in range(dim):
                        right[a, b] += strained[a, r, c] * turn[b, c]
            for a in range(dim):
                for b in range(dim):
                    entry = 0.0
                    for c in range(dim):
                        entry += turn[a, c] * right[c, b]
                    result[k, a, r, b] = entry
    return result
